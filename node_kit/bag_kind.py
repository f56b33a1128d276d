"""Which reader a bag needs, by its name and what metadata.yaml says of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from node_kit.plain_view import compression_of

SQLITE, ROS1 = ".db3", ".bag"


def is_foreign(path: Path, description: dict[str, Any] | None) -> bool:
    """Whether a file, or the folder that metadata.yaml describes, needs `foreign_bag.ForeignBag`."""
    if path.suffix in (SQLITE, ROS1):
        return True
    information = description or {}
    return information.get("storage_identifier") == "sqlite3" or compression_of(information) != "none"


def lone_file(path: Path) -> Path:
    """Return the one database or ROS 1 bag in a folder without metadata.yaml, else the path itself."""
    files = [file for file in path.iterdir() if file.suffix in (SQLITE, ROS1)] if path.is_dir() else []
    return files[0] if len(files) == 1 else path
