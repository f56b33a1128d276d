"""Files that the package brings along (config/, launch/), found in a checkout and where they are installed."""

from __future__ import annotations

import os
import sys
from importlib import metadata
from pathlib import Path

PACKAGE = "sphere_nav"


def share_file(name: str) -> Path:
    """Return the path of a shipped file such as `config/fastdds_large.xml`; ValueError if it is nowhere."""
    prefixes = [Path(prefix) for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(":") if prefix]
    places = [Path(__file__).resolve().parents[1]]
    places += [prefix / "share" / PACKAGE for prefix in (*prefixes, Path(sys.prefix))]
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
