"""A calibration that is refused."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest


def refusal(read: Callable[[Path], object], path: Path) -> str:
    """Return the one line by which a file is refused."""
    with pytest.raises(ValueError, match=re.escape(path.name)) as caught:
        read(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)
