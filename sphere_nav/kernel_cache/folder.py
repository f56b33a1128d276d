"""Where compiled kernels are kept: one folder for each text of one package's kernels, and of those they call."""

from __future__ import annotations

import ast
import hashlib
import shutil
from functools import cache
from pathlib import Path

from sphere_nav.params.homes import user_folder

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("cycab_sim", "mcl_depth", "sphere_mapping", "sphere_nav")
NUM_KEPT = 16  # texts of a package whose compiled kernels are kept: other environments, the last edits


def kernel_files(package: str) -> list[Path]:
    """Return every kernels.py of a package, relative to the folder that holds the packages."""
    return sorted(path.relative_to(ROOT) for path in (ROOT / package).rglob("kernels.py"))


@cache
def cache_folder(package: str) -> Path:
    """Return the folder of a package's present text, below NUMBA_CACHE_DIR or else the user's cache."""
    text = hashlib.sha256()
    for path in sorted(path for name in with_callees(package) for path in kernel_files(name)):
        text.update(f"{path.as_posix()}\n".encode())
        text.update((ROOT / path).read_bytes())
    return cache_root() / package / text.hexdigest()[:16]


def with_callees(package: str) -> set[str]:
    """Return a package and those of ours that its kernels import, directly or not."""
    found: set[str] = set()
    waiting = {package}
    while waiting:
        name = waiting.pop()
        found.add(name)
        waiting |= {callee for path in kernel_files(name) for callee in imports(ROOT / path)} - found
    return found


@cache
def imports(path: Path) -> set[str]:
    """Return the packages of ours that one file imports."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    names += [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)]
    return {name.split(".")[0] for name in names} & set(PACKAGES)


@cache
def cache_root() -> Path:
    """Return the folder that holds the caches of all packages."""
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
    gone = []
    for package in PACKAGES:
        others = [path for path in (cache_root() / package).glob("*") if path != cache_folder(package)]
        old = sorted(others, key=lambda path: path.stat().st_mtime, reverse=True)[NUM_KEPT - 1 :]
        for path in old:
            shutil.rmtree(path, ignore_errors=True)
        gone += old
    return gone
