"""A logger that repeats itself only so often."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any


class ThrottledLog:
    """Adds `every` seconds at most once a `key` to a logger with info, warning and error."""

    def __init__(self, logger: Any, clock: Callable[[], float] = time.monotonic) -> None:
        self._logger, self._clock = logger, clock
        self._last: dict[str, float] = {}

    def info(self, text: str, *, every: float = 0.0, key: str = "") -> None:
        """Say what happened."""
        if self._is_due(every, key or text):
            self._logger.info(text)

    def warning(self, text: str, *, every: float = 0.0, key: str = "") -> None:
        """Say what should be looked at."""
        if self._is_due(every, key or text):
            self._logger.warning(text)

    def error(self, text: str, *, every: float = 0.0, key: str = "") -> None:
        """Say what does not work."""
        if self._is_due(every, key or text):
            self._logger.error(text)

    def _is_due(self, every: float, key: str) -> bool:
        if every <= 0:
            return True
        now = self._clock()
        if now - self._last.get(key, float("-inf")) < every:
            return False
        self._last[key] = now
        return True
