"""How threads of Python take turns: one runs Python at a time."""

from __future__ import annotations

import sys

TURN_S = 5e-4  # after which a thread lets another one run that waits; 10 times that by itself


def take_short_turns() -> None:
    """Have what works in the background hold up an image for a moment only, each time that the image needs Python."""
    sys.setswitchinterval(TURN_S)
