"""Messages that check their fields: without that a wrong type becomes rubbish on the wire without a word."""

from __future__ import annotations

import sys

import pytest


@pytest.fixture(autouse=True)
def checked_fields(monkeypatch: pytest.MonkeyPatch) -> None:
    """Do what ROS_PYTHON_CHECK_FIELDS=1 does, for these tests only: it is slow with large arrays."""
    for module in list(sys.modules.values()):
        if getattr(module, "ros_python_check_fields", None) is not None:
            monkeypatch.setattr(module, "ros_python_check_fields", "1")
