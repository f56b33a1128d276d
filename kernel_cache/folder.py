"""Where compiled kernels are kept: one folder for each text of all kernels together."""

from __future__ import annotations

import hashlib
import os
import shutil
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("cycab_sim", "kernel_cache", "mcl_depth", "photometric", "sphere_mapping")
NUM_KEPT = 8  # texts whose compiled kernels are kept: other environments, the last edits


def kernel_files() -> list[Path]:
    """Return every kernels.py of the project, relative to the folder that holds the packages."""
    return sorted(path.relative_to(ROOT) for package in PACKAGES for path in (ROOT / package).rglob("kernels.py"))


@cache
def cache_folder() -> Path:
    """Return the folder of the present text, below NUMBA_CACHE_DIR or else the user's cache."""
    text = hashlib.sha256()
    for path in kernel_files():
        text.update(f"{path.as_posix()}\n".encode())
        text.update((ROOT / path).read_bytes())
    return cache_root() / text.hexdigest()[:16]


def cache_root() -> Path:
    """Return the folder that holds the caches of all texts."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    if given:
        return Path(given)
    cache_home = os.environ.get("XDG_CACHE_HOME")
    return (Path(cache_home) if cache_home else Path.home() / ".cache") / "sphere_nav" / "kernels"


def name_of(path: Path) -> str:
    """Return a name for one kernels.py of ours by its place in the project, empty for any other file."""
    try:
        relative = path.resolve().relative_to(ROOT)
    except ValueError:
        return ""
    is_ours = relative.name == "kernels.py" and relative.parts[0] in PACKAGES
    return ".".join(relative.parent.parts) if is_ours else ""


def remove_old() -> list[Path]:
    """Remove the compiled kernels of texts that were not used for longest, beyond `NUM_KEPT`; return what went."""
    present = cache_folder()
    others = [path for path in cache_root().glob("*") if path.is_dir() and path != present]
    old = sorted(others, key=lambda path: path.stat().st_mtime, reverse=True)[NUM_KEPT - 1 :]
    for path in old:
        shutil.rmtree(path, ignore_errors=True)
    return old
