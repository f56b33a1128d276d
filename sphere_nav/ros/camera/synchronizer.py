"""Which images of several streams are one instant, until when a late one is waited for, which cameras can be trusted.

The one queue of a set of streams: whatever an instant waits for (other cameras, depth, a LiDAR's cloud, the instants
that correct the rig), it waits for here. It knows no ROS.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sphere_nav.localization.constants import FROZEN_IMAGES, SAMPLE_STEP
from sphere_nav.ros.constants import BACK_NS, MAX_MISSES


@dataclass
class CameraHealth:
    """What a camera has delivered."""

    num_missing: int = 0
    num_repeats: int = 0  # equal images in a row, up to the newest
    num_misses: int = 0  # instants in a row without an image, up to the newest
    last_stamp_ns: int = -1
    problem: str = ""


@dataclass(frozen=True, eq=False)
class Instant:
    """Images by camera that belong together; `notes` says which cameras lack, and why.

    The images are in the order of the names; the stamp is that of the first.
    """

    stamp_ns: int
    images: dict[str, Any]
    notes: dict[str, str]


@dataclass(eq=False)
class _Open:
    stamp_ns: int
    opened_ns: int
    images: dict[str, tuple[int, Any]] = field(default_factory=dict)  # with their stamps


class Synchronizer:
    """Receives images one by one; hands out instants in order, each once.

    An instant is complete when all streams have it and `is_ready` says so of its stamp. One that is not goes
    `deadline_s` after its first image came. With no deadline stamps alone decide, so that a replay makes the same
    instants: one that is not complete goes when the next one begins, and a camera that missed `MAX_MISSES` in a row is
    not waited for. The first `num_first` instants are handed out together.
    """

    def __init__(
        self,
        names: Sequence[str],
        slack_s: float,
        deadline_s: float | None = None,
        *,
        is_ready: Callable[[int], bool] = lambda stamp_ns: True,
        num_first: int = 0,
    ) -> None:
        self.names, self._slack_s = tuple(names), slack_s
        self.health = {name: CameraHealth() for name in names}
        self._slack_ns = round(slack_s * 1e9)
        self._deadline_ns = None if deadline_s is None else round(deadline_s * 1e9)
        self._is_ready, self._num_first = is_ready, num_first
        self.clear()

    def clear(self) -> None:
        """Forget everything with a stamp: the clock jumped."""
        self._open: list[_Open] = []
        self._samples: dict[str, Any] = {}  # of the newest image of each
        self._closed_ns = -BACK_NS
        for health in self.health.values():
            health.last_stamp_ns, health.num_repeats, health.num_misses = -1, 0, 0

    def put(self, name: str, stamp_ns: int, image: Any, now_ns: int = 0) -> list[Instant]:
        """Add an image that came at `now_ns`; return the instants that end with it. ValueError: the stamp is refused.

        An image is an array, or whatever has none to compare with the one before.
        """
        if self._deadline_ns is None and stamp_ns < self._closed_ns - BACK_NS:
            self.clear()
        if stamp_ns <= max(self.health[name].last_stamp_ns, 0):
            raise ValueError(f"{name}: stamp: expected after {self.health[name].last_stamp_ns}, found {stamp_ns}")
        self._note(name, stamp_ns, image)
        if stamp_ns <= self._closed_ns + self._slack_ns:
            raise ValueError(f"{name}: stamp: expected after {self._closed_ns} (closed without it), found {stamp_ns}")
        self._add(name, stamp_ns, image, now_ns)
        return self.pop(now_ns)

    def pop(self, now_ns: int) -> list[Instant]:
        """Remove and return the instants complete or late by now; what is older than a complete one goes with it."""
        ended = []
        while (number := self._num_ended(now_ns)) >= max(self._num_first, 1):
            ended += self._close_first(number)
        return ended

    def _num_ended(self, now_ns: int) -> int:
        """Return how many of the open instants wait for nothing more."""
        done = [k for k, one in enumerate(self._open, 1) if self._is_complete(one) and self._is_ready(one.stamp_ns)]
        number = max(done, default=0)
        if self._deadline_ns is None:
            return max(number, len(self._open) - 1)  # the next one has begun
        while number < len(self._open) and now_ns - self._open[number].opened_ns >= self._deadline_ns:
            number += 1
        return number

    def flush(self) -> list[Instant]:
        """Remove and return all instants, in order: the recording has ended."""
        return self._close_first(len(self._open))

    def _is_complete(self, one: _Open) -> bool:
        given_up = MAX_MISSES if self._deadline_ns is None else np.inf
        return all(name in one.images or self.health[name].num_misses >= given_up for name in self.names)

    def _close_first(self, number: int) -> list[Instant]:
        closing, self._open, self._num_first = self._open[:number], self._open[number:], 0
        return [self._close(one) for one in closing]

    def _add(self, name: str, stamp_ns: int, image: Any, now_ns: int) -> None:
        """Add to the open instant nearest to a stamp that has no image of this stream yet, a new one where none is."""
        free = [one for one in self._open if name not in one.images and abs(one.stamp_ns - stamp_ns) <= self._slack_ns]
        if free:
            chosen = min(free, key=lambda one: abs(one.stamp_ns - stamp_ns))
        else:
            chosen = _Open(stamp_ns, now_ns)
            insort(self._open, chosen, key=lambda one: one.stamp_ns)
        chosen.images[name] = stamp_ns, image

    def _note(self, name: str, stamp_ns: int, image: Any) -> None:
        """Take down what a camera delivers, and whether that is new."""
        health, is_image = self.health[name], isinstance(image, np.ndarray) and image.dtype == np.uint8
        sample = image[::SAMPLE_STEP, ::SAMPLE_STEP].copy() if is_image else None
        before, self._samples[name] = self._samples.get(name), sample
        is_repeat = sample is not None and before is not None and np.array_equal(sample, before)
        health.num_repeats = health.num_repeats + 1 if is_repeat else 0
        health.num_misses, health.last_stamp_ns = 0, stamp_ns

    def _close(self, one: _Open) -> Instant:
        """Check the cameras of an instant."""
        self._closed_ns = max(self._closed_ns, one.stamp_ns)
        images, notes = {name: one.images[name][1] for name in self.names if name in one.images}, {}
        frozen = {name for name, health in self.health.items() if health.num_repeats >= FROZEN_IMAGES}
        if len(frozen) >= sum(health.last_stamp_ns >= 0 for health in self.health.values()):
            frozen.clear()  # the images of others have not changed, either
        for name in self.names:
            health = self.health[name]
            health.num_misses = 0 if name in images else health.num_misses + 1
            problem = "" if name in images else f"no image within {self._slack_s} s of the instant"
            if name in frozen:
                problem = f"frozen: the same image {health.num_repeats + 1} times"
                images.pop(name, None)
            if problem:
                notes[name] = problem
                health.num_missing += 1
            health.problem = problem
        stamp_ns = next(one.images[name][0] for name in self.names if name in one.images)
        return Instant(stamp_ns, images, notes)
