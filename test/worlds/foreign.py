"""A calibration of another program as `rig-convert` reads it."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from sphere_nav.geometry import Rig
from sphere_nav.geometry.files.foreign_rig import place_rig, read_foreign_cameras


def read_foreign(paths: Sequence[Path], frame: str = "camera", **options: Any) -> Rig:
    """Return the rig of files."""
    return place_rig(read_foreign_cameras(paths, **options), frame, paths[0])


def refusal(read: Callable[[Path], object], path: Path) -> str:
    """Return the one line by which a file is refused."""
    with pytest.raises(ValueError, match=re.escape(path.name)) as caught:
        read(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)
