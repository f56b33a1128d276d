"""Text files that are there as a whole or not at all, whatever ends the program or fills the disk."""

from __future__ import annotations

import os
from pathlib import Path

PART = ".part"  # ends the name of a file that is not whole


def write_whole(path: Path, text: str) -> None:
    """Write a text (UTF-8) in the place of what is there; OSError leaves that alone."""
    part = path.with_name(path.name + PART)
    with part.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())  # or the name could outlive what it stands for
    part.replace(path)
