"""Which reader a bag needs, by its name and what metadata.yaml says of it.

A compressed rosbag2 folder as a plain one: files are unpacked within limits, packed messages stay as they are.
"""

from __future__ import annotations

import json
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Any

from sphere_nav.geometry.files.untrusted import printable
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.unpack import unpack_file


def compression_of(description: dict[str, Any]) -> str:
    """Return what is compressed in a bag, by its metadata: none, file or message."""
    return str(description.get("compression_mode") or "none").lower()


class PlainView:
    """A temporary folder beside the bag: the metadata without compression, and the files it names."""

    def __init__(self, path: Path, description: dict[str, Any]) -> None:
        """Raise BagError for another method than zstd, or a file that cannot be unpacked."""
        mode, method = compression_of(description), str(description.get("compression_format") or "zstd")
        if mode not in ("file", "message") or method != "zstd":
            raise BagError(
                f"{path}: compression: expected zstd of files or messages, found {method[:40]} of {mode[:40]}"
            )
        self._folder = TemporaryDirectory(prefix="sphere_nav_")
        self.path = Path(self._folder.name)
        try:
            names = [self._add(path / PurePath(name).name, mode) for name in description["relative_file_paths"]]
            self.description = description | {
                "compression_mode": "",
                "compression_format": "",
                "relative_file_paths": names,
            }
            text = json.dumps({"rosbag2_bagfile_information": self.description}, default=str)
            (self.path / "metadata.yaml").write_text(text)
        except BaseException as error:
            self.close()
            if isinstance(error, BagError) or not isinstance(error, (OSError, ValueError, TypeError, RecursionError)):
                raise
            raise BagError(f"{path}: expected a readable bag, found: {printable(str(error))[:200]}") from None

    def _add(self, file: Path, mode: str) -> str:
        if not file.is_file():
            raise BagError(f"{file.parent}: relative_file_paths: expected {file.name}, found no such file")
        name = file.name if mode == "message" else file.stem
        if mode == "message":
            (self.path / name).symlink_to(file.resolve())
        else:
            unpack_file(file, self.path / name)
        return name

    def close(self) -> None:
        """Remove the folder."""
        self._folder.cleanup()


SQLITE, ROS1 = ".db3", ".bag"
SALVAGE = "to read what is whole: sqlite3 BAG.db3 .recover | sqlite3 NEW.db3, then ros2 bag reindex"


def is_foreign(path: Path, description: dict[str, Any] | None) -> bool:
    """Whether a file, or the folder that metadata.yaml describes, needs `foreign.ForeignBag`."""
    if path.suffix in (SQLITE, ROS1):
        return True
    return (description or {}).get("storage_identifier") == "sqlite3"


def lone_file(path: Path) -> Path:
    """Return the one database or ROS 1 bag in a folder without metadata.yaml, else the path itself."""
    files = [file for file in path.iterdir() if file.suffix in (SQLITE, ROS1)] if path.is_dir() else []
    return files[0] if len(files) == 1 else path
