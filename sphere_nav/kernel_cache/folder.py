"""Where compiled kernels are kept: one folder for each text of all kernels."""

from __future__ import annotations

import hashlib
import shutil
from functools import cache
from pathlib import Path

from sphere_nav.params.homes import user_folder

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("cycab_sim", "mcl_depth", "sphere_mapping", "sphere_nav")
PACKAGE = "sphere_nav"  # below which they are
NUM_KEPT = 16  # texts whose compiled kernels are kept: other environments, the last edits


@cache
def cache_folder() -> Path:
    """Return the folder of the present text of all kernels, below NUMBA_CACHE_DIR or else the user's cache."""
    text = hashlib.sha256()
    for path in sorted(path.relative_to(ROOT) for name in PACKAGES for path in (ROOT / name).rglob("kernels.py")):
        text.update(f"{path.as_posix()}\n".encode())
        text.update((ROOT / path).read_bytes())
    return cache_root() / PACKAGE / text.hexdigest()[:16]


@cache
def cache_root() -> Path:
    """Return the folder that holds the caches."""
    return user_folder(".cache/sphere_nav/kernels", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME")


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
    others = [path for path in cache_folder().parent.glob("*") if path != cache_folder()]
    old = sorted(others, key=lambda path: path.stat().st_mtime, reverse=True)[NUM_KEPT - 1 :]
    for path in old:
        shutil.rmtree(path, ignore_errors=True)
    return old
