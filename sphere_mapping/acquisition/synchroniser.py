"""Which images are one instant, until when a late camera is waited for, and which cameras can be trusted."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.params import SynchroniserParams

Image = NDArray[Any]  # levels, or metres of a depth camera

FINGERPRINT_STEP = 4  # every so many rows and columns of an image decide whether it is the last one again


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
    """Images by camera that belong together; `notes` says which cameras lack or are held, and why."""

    stamp_ns: int
    images: dict[str, Image]
    notes: dict[str, str]
    is_failed: bool = False


@dataclass(eq=False)
class _Open:
    stamp_ns: int
    opened_ns: int
    images: dict[str, Image] = field(default_factory=dict)


class Synchroniser:
    """Takes images one by one, with the time of arrival; hands out instants in order, each once."""

    def __init__(self, names: Sequence[str], params: SynchroniserParams) -> None:
        self.names, self.params = tuple(names), params
        self.health = {name: CameraHealth() for name in names}
        self._slack_ns, self._deadline_ns = round(params.slack_s * 1e9), round(params.deadline_s * 1e9)
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
        self._place(stamp_ns, now_ns).images[name] = image
        return self.take(now_ns)

    def take(self, now_ns: int) -> list[Instant]:
        """Return the instants that are complete or late by now; what is older than a complete one goes with it."""
        done = []
        while self._open:
            is_complete = [len(one.images) == len(self.names) for one in self._open]
            is_late = now_ns - self._open[0].opened_ns >= self._deadline_ns
            if not (any(is_complete) or is_late):
                break
            done.append(self._close(self._open.pop(0)))
        return done

    def flush(self) -> list[Instant]:
        """Return what is still open, in order: the recording has ended."""
        found = [self._close(one) for one in self._open]
        self._open = []
        return found

    def problems(self) -> list[str]:
        """Return, in words, what the newest instant lacked, and how often that was so."""
        found = [(name, health) for name, health in self.health.items() if health.problem]
        return [f"{name}: {health.problem} ({health.num_missing} times)" for name, health in found]

    def _place(self, stamp_ns: int, now_ns: int) -> _Open:
        for one in self._open:
            if abs(one.stamp_ns - stamp_ns) <= self._slack_ns:
                return one
        self._open.append(_Open(stamp_ns, now_ns))
        self._open.sort(key=lambda one: one.stamp_ns)
        return next(one for one in self._open if one.stamp_ns == stamp_ns)

    def _note(self, name: str, stamp_ns: int, image: Image) -> None:
        health, print_now = self.health[name], fingerprint(image)
        is_repeat = name in self._last and self._last[name][2] == print_now
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
        return Instant(one.stamp_ns, images, notes, bool(notes) and self.params.policy == "fail")

    def _may_hold(self, name: str, stamp_ns: int) -> bool:
        return name in self._last and abs(stamp_ns - self._last[name][0]) <= self.params.max_hold_s * 1e9

    def _frozen(self) -> set[str]:
        """Return cameras whose image has not changed for long while others' has."""
        stuck = {name for name, health in self.health.items() if health.num_repeats >= self.params.frozen_after}
        return stuck if len(stuck) < len([n for n in self.names if self.health[n].num_images]) else set()


def fingerprint(image: Image) -> int:
    """Return a number that equal images share."""
    return zlib.crc32(np.ascontiguousarray(image[::FINGERPRINT_STEP, ::FINGERPRINT_STEP]).tobytes())
