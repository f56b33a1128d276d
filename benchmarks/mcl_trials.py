"""A filter let loose on a drive, and what it said of each image beside the truth."""

from __future__ import annotations

import copy
import hashlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.mcl_drives import Drive
from mcl_depth.belief.particles import wrap_angle
from mcl_depth.belief.resampling import sample_uniform
from mcl_depth.filter import Filter
from mcl_depth.geometry.area import Area
from mcl_depth.likeness.depth_cache import Cell
from mcl_depth.likeness.depth_map import DepthMap
from mcl_depth.likeness.kinds import Visual
from mcl_depth.params import FilterParams
from mcl_depth.site import Site
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.status import Reason, State

NEAR_M, NEAR_DEG = 1.0, 10.0  # a pose this close to the truth is the right place


@dataclass(frozen=True)
class Trial:
    """What a filter said of K images: state and reason, errors of the likeliest place (K,), particles, time."""

    states: tuple[State, ...]
    reasons: tuple[str, ...]
    meters: Array
    degrees: Array
    counts: NDArray[np.int64]
    milliseconds: Array
    p_chance: Array

    @property
    def is_right(self) -> NDArray[np.bool_]:
        """Whether the likeliest place was the right one, (K,)."""
        return (self.meters <= NEAR_M) & (self.degrees <= NEAR_DEG)

    @property
    def is_tracking(self) -> NDArray[np.bool_]:
        """Whether the status was TRACKING, (K,)."""
        return np.array([state is State.TRACKING for state in self.states])

    @property
    def is_trusted(self) -> NDArray[np.bool_]:
        """Whether a pose left the filter: TRACKING or DEGRADED, (K,)."""
        return np.array([state in (State.TRACKING, State.DEGRADED) for state in self.states])

    @property
    def is_ambiguous(self) -> NDArray[np.bool_]:
        """Whether the reason was AMBIGUOUS, (K,)."""
        return np.array([reason == Reason.AMBIGUOUS for reason in self.reasons])

    @property
    def has_converged(self) -> bool:
        """Whether the last image found the filter in TRACKING at the right place."""
        return bool(self.is_tracking[-1] and self.is_right[-1])

    @property
    def num_false(self) -> int:
        """Images with the status TRACKING at a wrong place."""
        return int(np.sum(self.is_tracking & ~self.is_right))

    @property
    def first(self) -> int:
        """Number of the image, from 1, from which on it tracked the right place to the end; 0: never."""
        good = self.is_tracking & self.is_right
        bad = np.flatnonzero(~good)
        number = int(bad[-1]) + 2 if len(bad) else 1
        return number if number <= len(good) else 0


def run_filter(
    site: Site,
    drive: Drive,
    params: FilterParams,
    seed: int,
    *,
    has_imu: bool = True,
    before_image: Callable[[], None] | None = None,
    start_area: Area | None = None,
    start: tuple[Array, Array] | None = None,
) -> Trial:
    """Return what a filter says of the images of a drive; `before_image` is not timed.

    It knows nothing, or that it is somewhere in `start_area`, or a `start`: pose (3,) and standard deviations (3,).
    """
    filter_ = Filter(replace(params, seed=seed), site.depth_map, site.area)
    if start_area is not None:
        filter_.particles = sample_uniform(start_area, params.resampling.num_particles, np.random.default_rng(seed))
    if start is not None:
        (x, y, yaw), (sigma_x, sigma_y, sigma_yaw) = start
        covariance = np.diag(np.square([sigma_x, sigma_y, 0.1, 0.1, 0.1, sigma_yaw]))
        filter_.start(SE3.from_planar(float(x), float(y), float(yaw)), covariance)
    found: list[tuple[Any, ...]] = []
    for index in range(len(drive)):
        if before_image is not None:
            before_image()
        started = time.perf_counter()
        estimate = filter_.update(drive.observation(index, has_imu=has_imu))
        elapsed = 1e3 * (time.perf_counter() - started)
        pose, status = place_of(estimate), estimate.status
        error = pose - drive.truth(index)
        degrees = abs(float(np.degrees(wrap_angle(error[2]))))
        found.append(
            (
                status.state,
                str(status.reason),
                np.hypot(*error[:2]),
                degrees,
                len(filter_.particles),
                elapsed,
                status.p_chance,
            )
        )
    states, reasons, meters, degrees_, counts, times, chances = zip(*found, strict=True)
    return Trial(
        states, reasons, np.array(meters), np.array(degrees_), np.array(counts), np.array(times), np.array(chances)
    )


def place_of(estimate: Any) -> Array:
    """Return x, y, yaw (3,) of what leaves the filter, else of its likeliest place, else NaN."""
    if estimate.T_map_level is not None:
        T_map_level: SE3 = estimate.T_map_level
        return np.array([*T_map_level.translation[:2], float(T_map_level.yaw)])
    if estimate.belief is not None:
        return np.asarray(estimate.belief.best.pose)
    return np.full(3, np.nan)


class RememberingMap(DepthMap):
    """A map that compares a picture with a cell once, however many filters ask: for many runs over the same images."""

    def __init__(self, other: DepthMap) -> None:
        """Share everything with another map."""
        self.__dict__.update(other.__dict__)
        self._known: dict[bytes, dict[Cell, NDArray[np.float32]]] = {}

    def similarities(self, visual: Visual, cells: Sequence[Cell], num_headings: int) -> NDArray[np.float32]:
        """Return the similarity (N, num_headings) of an image with the depth images of cells."""
        key = hashlib.sha1(visual.identity + bytes([num_headings % 256]), usedforsecurity=False).digest()
        known = self._known.setdefault(key, {})
        missing = [cell for cell in dict.fromkeys(cells) if cell not in known]
        if missing:
            found = super().similarities(visual, missing, num_headings)
            known.update(zip(missing, found, strict=True))
        return np.stack([known[cell] for cell in cells]) if len(cells) else np.zeros((0, num_headings), np.float32)


def remembering(site: Site) -> Site:
    """Return the site with a map that remembers comparisons."""
    other = copy.copy(site)
    other.depth_map = RememberingMap(site.depth_map)
    return other
