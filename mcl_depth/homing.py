"""Follow a path by motion direction alone (N17 section III-D): where is the next waypoint, seen from the vehicle?

The pose is not tracked: for every image, depth images around the next waypoint alone are compared. The best of them
tells on which side of the waypoint the vehicle is; the way back from there is the motion direction. Near the waypoint
that is chance, so a vehicle steers for the path beyond it, as far as the samples reach.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from mcl_depth.belief.motion_model import wrap_angle
from mcl_depth.belief.particles import best_headings
from mcl_depth.constants import MIN_LEAD, NUM_DIRECTIONS, NUM_DISTANCES, NUM_MEDIAN, NUM_PASSED, REACH
from mcl_depth.likeness.depth_map import Comparison
from mcl_depth.params import DirectionParams
from sphere_nav.geometry.arrays import Array, arc_lengths


@dataclass(frozen=True)
class Advice:
    """The way to the next waypoint; angles in rad."""

    in_vehicle: float  # to the path beyond it, from where the vehicle heads, positive to the left
    lead: float  # of the best sample over the others, standard deviations
    is_clear: bool = True  # the last images agree, and their samples stand out
    is_finished: bool = False


class Homing:
    """Goes from waypoint to waypoint; `compare` gives the comparison of an image with the map."""

    def __init__(self, path: Array, params: DirectionParams) -> None:
        """`path` (N, 2) m; the vehicle is near the first waypoint of the path resampled at `params.spacing`."""
        self.waypoints = waypoints_of(path, params.spacing)
        self._way = arc_lengths(self.waypoints).tolist()
        self._params = params
        self._offsets = sample_offsets(params.distance_step)
        self.restart()

    def restart(self) -> None:
        """Say that the vehicle is near the first waypoint."""
        self.next = 0
        self.is_finished = False
        self._places: deque[Array] = deque(maxlen=NUM_MEDIAN)
        self._leads: deque[float] = deque(maxlen=NUM_MEDIAN)
        self._num_passed = 0

    def update(self, comparison: Comparison) -> Advice:
        """Return the direction for one image: the median over the last few."""
        samples = self.waypoints[self.next] + self._offsets
        curves = comparison.curves(samples)
        best_of = curves.max(axis=1).astype(np.float64)
        best = int(np.argmax(best_of))
        spread = float(best_of.std())
        lead = float((best_of[best] - best_of.mean()) / spread) if spread > 0.0 else 0.0
        self._places.append(samples[best])
        self._leads.append(lead)
        self._pass(samples[best])
        heading = float(best_headings(curves[best : best + 1])[0])
        waypoint = self.waypoints[self.next]
        beyond = waypoint + NUM_DISTANCES * self._params.distance_step * self._tangent(self.next)
        in_vehicle = float(wrap_angle(np.array(self._median_direction(beyond) - heading)))
        is_clear = self.is_finished or float(np.median(self._leads)) >= MIN_LEAD  # no way is left that could be unclear
        return Advice(in_vehicle, lead, is_clear, self.is_finished)

    @property
    def gone(self) -> float:
        """Return the way in m from the beginning of the path to the last waypoint passed."""
        return self._way[max(self.next - 1, 0)] if not self.is_finished else self._way[-1]

    @property
    def left(self) -> float:
        """Return the way in m from the last waypoint passed to the end."""
        return self._way[-1] - self.gone

    def _pass(self, place: Array) -> None:
        """Go on to the next waypoint when the vehicle has been at it, or beyond it, for some images in a row."""
        waypoint, last = self.waypoints[self.next], len(self.waypoints) - 1
        ahead = self._tangent(self.next)
        offset = place - waypoint
        is_there = float(np.linalg.norm(offset)) < REACH * self._params.distance_step or float(offset @ ahead) > 0.0
        self._num_passed = self._num_passed + 1 if is_there else 0
        if self._num_passed >= NUM_PASSED:
            self.is_finished = self.is_finished or self.next == last
            self.next, self._num_passed = min(self.next + 1, last), 0

    def _median_direction(self, goal: Array) -> float:
        """Return the median direction to a point from the last places; that of the path where they are it."""
        ways = goal - np.array(self._places)
        at_it = np.linalg.norm(ways, axis=1) < 1e-6
        ways[at_it] = self._tangent(self.next)
        angles = np.arctan2(ways[:, 1], ways[:, 0])
        middle = float(np.angle(np.exp(1j * angles).sum()))
        return float(wrap_angle(np.array(middle + np.median(wrap_angle(angles - middle)))))

    def _tangent(self, index: int) -> Array:
        """Return the direction of the path at a waypoint, (2,) of unit length."""
        before, after = max(index - 1, 0), min(index + 1, len(self.waypoints) - 1)
        way = self.waypoints[after] - self.waypoints[before]
        return way / max(float(np.linalg.norm(way)), 1e-9)


def sample_offsets(step: float) -> Array:
    """Return the samples (K, 2) around a waypoint, the waypoint itself first."""
    psi = np.arange(NUM_DIRECTIONS) * 2.0 * np.pi / NUM_DIRECTIONS
    ring = np.stack([np.cos(psi), np.sin(psi)], axis=1)
    return np.concatenate([np.zeros((1, 2)), *(step * (k + 1) * ring for k in range(NUM_DISTANCES))])


def waypoints_of(path: Array, spacing: float) -> Array:
    """Return points (M, 2) `spacing` m apart along a path (N, 2), its end included; ValueError for less than two."""
    path = np.asarray(path, dtype=np.float64)
    if path.ndim != 2 or path.shape[1] != 2 or len(path) < 2 or not np.all(np.isfinite(path)):
        raise ValueError(f"path: expected at least two finite points (N, 2), found shape {path.shape}")
    lengths = arc_lengths(path)
    count = max(int(np.ceil(lengths[-1] / spacing)), 1)
    at = np.linspace(0.0, lengths[-1], count + 1)
    return np.stack([np.interp(at, lengths, path[:, axis]) for axis in range(2)], axis=1)
