"""A calibration of another program as `rig-convert` reads it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sphere_nav.geometry import Rig
from sphere_nav.geometry.files.foreign_rig import place_rig, read_foreign_cameras


def read_foreign(paths: Sequence[Path], frame: str = "camera", **options: Any) -> Rig:
    """Return the rig of files."""
    return place_rig(read_foreign_cameras(paths, **options), frame, paths[0])
