"""Images of one instant, put together from several streams by their stamps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Generic, TypeVar

T = TypeVar("T")

MAX_WAITING = 30  # items of a stream that wait for the others; about a second of images


class Pairing(Generic[T]):
    """Takes items by stream and stamp; hands out those of one instant, oldest first, each at most once."""

    def __init__(self, streams: Sequence[str], slack_ns: int) -> None:
        self._waiting: dict[str, dict[int, T]] = {name: {} for name in streams}
        self._slack_ns = slack_ns
        self._latest_ns = -1
        self.num_unpaired = 0  # items given up because their counterpart never came

    def put(self, stream: str, stamp_ns: int, item: T) -> tuple[int, dict[str, T]] | None:
        """Add an item; return stamp (of the first stream) and items by stream where that completes an instant."""
        if stamp_ns <= self._latest_ns - self._slack_ns:
            raise ValueError(f"{stream}: expected a stamp after {self._latest_ns}, found {stamp_ns}")
        self._waiting[stream][stamp_ns] = item
        found = {name: self._nearest(name, stamp_ns) for name in self._waiting}
        if any(stamp is None for stamp in found.values()):
            self._give_up(stream)
            return None
        stamps = {name: stamp for name, stamp in found.items() if stamp is not None}
        items = {name: self._waiting[name][stamp] for name, stamp in stamps.items()}
        self._latest_ns = max(stamps.values())
        self._forget_older()
        return next(iter(stamps.values())), items

    def clear(self) -> None:
        """Forget everything: the clock jumped."""
        for waiting in self._waiting.values():
            waiting.clear()
        self._latest_ns = -1

    def _nearest(self, stream: str, stamp_ns: int) -> int | None:
        nearest = min(self._waiting[stream], key=lambda stamp: (abs(stamp - stamp_ns), stamp), default=None)
        return nearest if nearest is not None and abs(nearest - stamp_ns) <= self._slack_ns else None

    def _forget_older(self) -> None:
        for waiting in self._waiting.values():
            for stamp in [stamp for stamp in waiting if stamp <= self._latest_ns]:
                del waiting[stamp]

    def _give_up(self, stream: str) -> None:
        waiting = self._waiting[stream]
        while len(waiting) > MAX_WAITING:
            del waiting[min(waiting)]
            self.num_unpaired += 1
