"""Files that the package brings along (config/, launch/), found in a checkout and where they are installed."""

from __future__ import annotations

import os
import sys
from importlib import metadata
from pathlib import Path

PACKAGE = "sphere_nav"


def share_file(name: str) -> Path:
    """Return the path of a shipped file such as `config/fastdds_large.xml`; ValueError if it is nowhere."""
    root = Path(__file__).resolve().parents[2]  # a checkout, site-packages, or what pip --target made
    prefixes = [Path(prefix) for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(":") if prefix]
    around = (root, *root.parents[:3])  # PREFIX/lib/python3.x/site-packages, also of pip --user and --prefix
    places = [root, *(prefix / "share" / PACKAGE for prefix in (*prefixes, Path(sys.prefix), *around))]
    for place in places:
        if (place / name).is_file():
            return place / name
    raise ValueError(f"{name}: file of {PACKAGE} not found in {', '.join(map(str, places))}")


def software() -> str:
    """Return name and version of the installed package."""
    try:
        return f"{PACKAGE} {metadata.version(PACKAGE)}"
    except metadata.PackageNotFoundError:
        return f"{PACKAGE} (not installed)"
