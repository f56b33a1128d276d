"""Recordings with few images: a localiser must wait for the next one longer than behind a live camera."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence

from localization.params import InputParams
from node_kit.streams import Stream

PERIODS = 4.0  # a silence; recordings drop images
TIMEOUT = "input.timeout_s"


def patience(streams: Sequence[Stream], images: Iterable[str]) -> dict[str, float]:
    """Return the time-out for the slowest of the topics with images, where the default is too short for it."""
    wanted, default = set(images), InputParams().timeout_s
    rates = [stream.rate_hz for stream in streams if stream.topic in wanted and stream.count > 1]
    if not rates or min(rates) <= 0.0 or PERIODS / min(rates) <= default:
        return {}
    timeout_s = round(PERIODS / min(rates), 3)
    text = f"an image every {1.0 / min(rates):.2f} s: {TIMEOUT}={timeout_s:g} (else {default:g})"
    logging.getLogger("sphere_nav.slow_camera").warning(text)
    return {TIMEOUT: timeout_s}
