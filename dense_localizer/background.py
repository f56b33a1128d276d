"""What works beside the images of a live camera takes one core: one thread at a time, the urgent one first."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Condition


class Background:
    """Whose turn it is. The images' own thread asks for none: with two cores, one is free when an image comes."""

    def __init__(self, *, is_limited: bool) -> None:
        """Unless it `is_limited`, all work at once."""
        self._is_limited, self._change = is_limited, Condition()
        self._is_busy, self._num_urgent = False, 0

    @contextmanager
    def work(self, *, is_urgent: bool = False) -> Iterator[None]:
        """Wait for the turn, and have it within the block."""
        if not self._is_limited:
            yield
            return
        with self._change:
            self._num_urgent += is_urgent
            self._change.wait_for(lambda: not self._is_busy and (is_urgent or not self._num_urgent))
            self._num_urgent -= is_urgent
            self._is_busy = True
        try:
            yield
        finally:
            with self._change:
                self._is_busy = False
                self._change.notify_all()
