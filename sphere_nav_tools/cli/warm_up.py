"""Compile the kernels of all packages once, so that no node waits: `python -m sphere_nav_tools.cli.warm_up`.

An installation ends with it; where the kernels are compiled already it takes seconds.
"""

from __future__ import annotations

import gc
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context

from cycab_sim.warm_up import warm_up as warm_up_simulator
from mcl_depth.params import FilterParams
from mcl_depth.warm_up import warm_up as warm_up_mcl
from sphere_mapping.acquisition.warm_up import warm_up as warm_up_acquisition
from sphere_nav import photometric
from sphere_nav.kernel_cache.folder import cache_folder, cache_root, remove_old
from sphere_nav.spheres.appearance.headings import warm_up as warm_up_headings
from sphere_nav.view_synthesis.synthesis import warm_up as warm_up_view


def warm_up_registration() -> None:
    """One after the other: kernels of view synthesis call those of registration."""
    photometric.warm_up()
    warm_up_view()
    warm_up_headings()


# the longest first
PARTS = (partial(warm_up_mcl, FilterParams()), warm_up_registration, warm_up_simulator, warm_up_acquisition)


def main() -> int:
    """Compile what is not compiled yet, on all cores."""
    if not cache_folder().is_dir():
        print(f"compiling kernels into {cache_root()}, a minute or two", file=sys.stderr)
    jobs = min(os.cpu_count() or 1, len(PARTS))
    # a compiler makes much and drops little: without the garbage collector it needs a tenth less time
    with ProcessPoolExecutor(jobs, get_context("spawn"), initializer=gc.disable) as workers:
        for part in [workers.submit(part) for part in PARTS]:
            part.result()
    remove_old()
    return 0


if __name__ == "__main__":
    sys.exit(main())
