"""Compile the kernels of all packages once, so that no node waits: `python -m sphere_nav_cli.warm_up`.

An installation ends with it; where the kernels are compiled already it takes seconds.
"""

from __future__ import annotations

import sys

import photometric
from kernel_cache.folder import PACKAGES, cache_folder, cache_root, remove_old
from mcl_depth.params import FilterParams
from mcl_depth.warm_up import warm_up as warm_up_mcl
from sphere_mapping.acquisition import kernels as acquisition
from view_synthesis.warm_up import warm_up as warm_up_view


def main() -> int:
    """Compile what is not compiled yet."""
    if not all(cache_folder(package).is_dir() for package in PACKAGES):
        print(f"compiling kernels into {cache_root()}, a minute or two", file=sys.stderr)
    photometric.warm_up()
    acquisition.warm_up()
    warm_up_mcl(FilterParams())
    warm_up_view()
    remove_old()
    return 0


if __name__ == "__main__":
    sys.exit(main())
