"""What the package brings along: files (config/, launch/), found in a checkout and where they are installed; nodes."""

from __future__ import annotations

import os
import sys
from importlib import metadata
from pathlib import Path

PACKAGE = "sphere_nav"
NODES = "sphere_nav.nodes"  # entry points of setup.py


def main() -> int:
    """Run a node, named as its executable; before the second that importing it takes say that it starts."""
    use_one_thread()
    name = Path(sys.argv[0]).name
    if not {"--help", "-h"} & set(sys.argv):
        sys.stderr.write(f"{name}: {software()} starts\n")
        sys.stderr.flush()
    return int(node_entry(name).load()())


def use_one_thread() -> None:
    """Let OpenBLAS multiply in one thread, unless the user says otherwise; NumPy reads that when it is imported.

    Our matrices have some ten columns: its threads would wait for each other for longer than they compute.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def node_entry(name: str) -> metadata.EntryPoint:
    """Return where a node begins; ValueError for one that is not installed."""
    entries = tuple(metadata.entry_points(group=NODES, name=name))
    if not entries:
        raise ValueError(f"{name}: expected an installed executable of this name, found none: install sphere_nav anew")
    return entries[0]


def share_file(name: str) -> Path:
    """Return the path of a shipped file such as `config/fastdds_large.xml`; ValueError if it is nowhere."""
    code = Path(__file__).resolve().parents[1]
    places = [code.parent, *share_folders(PACKAGE, code)]  # a checkout has them beside the code
    for place in places:
        if (place / name).is_file():
            return place / name
    raise ValueError(f"{name}: file of {PACKAGE} not found in {', '.join(map(str, places))}")


def share_folders(package: str, code: Path | None) -> list[Path]:
    """Return where the shipped files of a package may be, by its name and the folder of its module, if it has one.

    Of the prefixes of ament and of the interpreter, and around the code: pip --target, --user and --prefix install
    into other ones.
    """
    prefixes = [Path(prefix) for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(":") if prefix]
    around = code.parents[:4] if code is not None else ()  # PREFIX/lib/python3.x/site-packages, or PREFIX itself
    return [prefix / "share" / package for prefix in (*prefixes, Path(sys.prefix), *around)]


def software() -> str:
    """Return name and version of the installed package."""
    try:
        return f"{PACKAGE} {metadata.version(PACKAGE)}"
    except metadata.PackageNotFoundError:
        return f"{PACKAGE} (not installed)"
