"""Files that the package brings along (config/, launch/), found in a checkout and where they are installed."""

from __future__ import annotations

import os
import sys
from importlib import metadata
from pathlib import Path

PACKAGE = "sphere_nav"


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
