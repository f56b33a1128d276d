"""Which images are one instant, until when a late one is waited for, and which cameras can be trusted.

The one queue of a set of streams: whatever an instant waits for (other cameras, depth, a LiDAR's cloud, the instants
that correct the rig), it waits for here.
"""

from __future__ import annotations

import zlib
from bisect import insort
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.params import SynchroniserParams

Image = NDArray[Any]  # levels, or metres of a depth camera

FINGERPRINT_STEP = 4  # every so many rows and columns of an image decide whether it is the last one again
MAX_HOLD_NS = 500_000_000  # largest age of an image that is held for a late one
FROZEN_AFTER = 3  # equal images in a row, while other cameras change, that are a frozen camera


@dataclass
class CameraHealth:
    """What a camera has delivered."""

    num_images: int = 0
    num_missing: int = 0
    num_refused: int = 0
    num_repeats: int = 0  # equal images in a row, up to the newest
    last_stamp_ns: int = -1
    problem: str = ""


@dataclass(frozen=True, eq=False)
class Instant:
    """Images by camera that belong together; `notes` says which cameras lack or are held, and why.

    The stamp is that of the first camera, in the order of the names, that has an image.
    """

    stamp_ns: int
    images: dict[str, Image]
    notes: dict[str, str]
    is_failed: bool = False


@dataclass(eq=False)
class _Open:
    stamp_ns: int
    opened_ns: int
    images: dict[str, Image] = field(default_factory=dict)
    stamps: dict[str, int] = field(default_factory=dict)


class Synchroniser:
    """Receives images one by one, with the time of arrival; hands out instants in order, each once.

    An instant is complete when all streams have it and `is_ready` says so of its stamp. The first `num_first` instants
    are handed out together.
    """

    def __init__(
        self,
        names: Sequence[str],
        params: SynchroniserParams,
        is_ready: Callable[[int], bool] = lambda stamp_ns: True,
        num_first: int = 0,
    ) -> None:
        self.names, self.params = tuple(names), params
        self.health = {name: CameraHealth() for name in names}
        self._slack_ns, self._deadline_ns = round(params.slack_s * 1e9), round(params.deadline_s * 1e9)
        self._is_ready, self._num_first = is_ready, num_first
        self.clear()

    def clear(self) -> None:
        """Forget everything with a stamp: the clock jumped."""
        self._open: list[_Open] = []
        self._last: dict[str, tuple[int, Image, int]] = {}
        self._closed_ns = -1
        for health in self.health.values():
            health.last_stamp_ns, health.num_repeats = -1, 0

    def put(self, name: str, stamp_ns: int, image: Image, now_ns: int) -> list[Instant]:
        """Add an image; return the instants that are complete, or late, by now. ValueError: the stamp is refused."""
        health = self.health[name]
        if stamp_ns <= max(health.last_stamp_ns, 0):
            health.num_refused += 1
            raise ValueError(f"{name}: stamp: expected after {health.last_stamp_ns}, found {stamp_ns}")
        self._note(name, stamp_ns, image)
        if stamp_ns <= self._closed_ns + self._slack_ns:
            health.num_refused += 1
            raise ValueError(f"{name}: stamp: expected after {self._closed_ns} (closed without it), found {stamp_ns}")
        one = self._place(name, stamp_ns, now_ns)
        one.images[name], one.stamps[name] = image, stamp_ns
        return self.pop(now_ns)

    def pop(self, now_ns: int) -> list[Instant]:
        """Remove and return the instants complete or late by now; what is older than a complete one goes with it."""
        number = 0
        for k, one in enumerate(self._open):
            if len(one.images) == len(self.names) and self._is_ready(one.stamp_ns):
                number = k + 1
        while number < len(self._open) and now_ns - self._open[number].opened_ns >= self._deadline_ns:
            number += 1
        return self._close_first(number) if number >= max(self._num_first, 1) else []

    def flush(self) -> list[Instant]:
        """Remove and return all instants, in order: the recording has ended."""
        return self._close_first(len(self._open))

    def _close_first(self, number: int) -> list[Instant]:
        closing, self._open, self._num_first = self._open[:number], self._open[number:], 0
        return [self._close(one) for one in closing]

    def _place(self, name: str, stamp_ns: int, now_ns: int) -> _Open:
        """Return the open instant nearest to a stamp that has no image of this stream yet, a new one where none is."""
        free = [one for one in self._open if name not in one.images and abs(one.stamp_ns - stamp_ns) <= self._slack_ns]
        if free:
            return min(free, key=lambda one: abs(one.stamp_ns - stamp_ns))
        fresh = _Open(stamp_ns, now_ns)
        insort(self._open, fresh, key=lambda one: one.stamp_ns)
        return fresh

    def _note(self, name: str, stamp_ns: int, image: Image) -> None:
        health, print_now = self.health[name], fingerprint(image)
        is_repeat = image.dtype == np.uint8 and name in self._last and self._last[name][2] == print_now
        health.num_repeats = health.num_repeats + 1 if is_repeat else 0
        health.num_images, health.last_stamp_ns = health.num_images + 1, stamp_ns
        self._last[name] = (stamp_ns, image, print_now)

    def _close(self, one: _Open) -> Instant:
        """Judge the cameras of an instant, fill gaps by the policy."""
        self._closed_ns = max(self._closed_ns, one.stamp_ns)
        images, notes = dict(one.images), {}
        frozen = self._frozen()
        for name in self.names:
            problem = "" if name in images else f"no image within {self.params.slack_s} s of the instant"
            if name in frozen:
                problem = f"frozen: the same image {self.health[name].num_repeats + 1} times"
                images.pop(name, None)
            elif problem and self.params.policy == "hold" and self._may_hold(name, one.stamp_ns):
                images[name] = self._last[name][1]
                problem += ", the last one is held"
            if problem:
                notes[name] = problem
                self.health[name].num_missing += 1
            self.health[name].problem = problem
        stamp_ns = next(one.stamps[name] for name in self.names if name in one.stamps)
        return Instant(stamp_ns, images, notes, bool(notes) and self.params.policy == "fail")

    def _may_hold(self, name: str, stamp_ns: int) -> bool:
        return name in self._last and abs(stamp_ns - self._last[name][0]) <= MAX_HOLD_NS

    def _frozen(self) -> set[str]:
        """Return cameras whose image has not changed for long while others' has."""
        stuck = {name for name, health in self.health.items() if health.num_repeats >= FROZEN_AFTER}
        return stuck if len(stuck) < len([n for n in self.names if self.health[n].num_images]) else set()


def fingerprint(image: Image) -> int:
    """Return a number that equal images share."""
    return zlib.crc32(np.ascontiguousarray(image[::FINGERPRINT_STEP, ::FINGERPRINT_STEP]).tobytes())
