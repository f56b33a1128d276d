"""Range of what one instant does not measure, by spheres of earlier instants: the drive is the baseline.

Every direction is tried at inverse ranges a pixel apart. The earlier spheres are sampled where a point at that range
would be, and squared differences of levels, less their mean around, are summed over a block. What is taken must be the
least by far of all ranges, must fit every earlier sphere as well as noise allows (what has moved since does not), must
not be as well explained by what moves with the rig, must have texture on all sides, and lies beside no jump. Directions
that the instant has measured are compared, too: they say how much too small the deviations are, and where the drive is
not believed. The deviation is by the slopes of the levels, by what is left, and by how well the motion is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.constants import (
    AGREEMENT_SIGMAS,
    COST_RADIUS,
    DEPENDENT_SHARE,
    DRIVE_AROUND_PX,
    DRIVE_BLOCK_PX,
    DRIVE_CAP,
    DRIVE_CLEAR,
    DRIVE_COMPARED,
    DRIVE_EDGE_PX,
    DRIVE_HYPOTHESES,
    DRIVE_MISSED,
    DRIVE_PX,
    DRIVE_QUANTILE,
    DRIVE_REACH,
    DRIVE_SIDE_SHARE,
    DRIVE_WIDTH,
    FAR_M,
    LEAST_NOISE,
    MAX_RESIDUAL,
    NUM_EARLIER,
    STD_FACTOR,
)
from sphere_mapping.acquisition.params import MatchParams
from sphere_mapping.acquisition.range.fusion import Ranged, fill_unknown
from sphere_mapping.acquisition.range.levels import at_jumps, at_unknown
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.spheres.sphere import Sphere

Plane = NDArray[np.float32]
Flags = NDArray[np.bool_]
NEVER = np.float32(1e9)  # cost of what was not seen


@dataclass(frozen=True, eq=False)
class PlacedSphere:
    """A sphere at T (in the map, or in the frame of another sphere), and the covariance (6, 6) of xi in T exp(xi)."""

    sphere: Sphere
    T: SE3
    covariance: Array

    def by(self, other: PlacedSphere) -> PlacedSphere:
        """Return it in the frame of another sphere, whose covariance is added, as if their errors were independent."""
        T = other.T.inverse() @ self.T
        adjoint = T.inverse().adjoint()
        return PlacedSphere(self.sphere, T, self.covariance + adjoint @ other.covariance @ adjoint.T)


class DriveRange:
    """Keeps the last sphere, and some before it that are apart."""

    def __init__(self, params: MatchParams | None = None) -> None:
        self._params = params or MatchParams()
        self._kept: list[PlacedSphere] = []
        self._last: PlacedSphere | None = None

    def add(self, sphere: Sphere, T_map_sphere: SE3, covariance: Array) -> None:
        """Take down the next sphere of a drive."""
        last, self._last = self._last, PlacedSphere(sphere, T_map_sphere, covariance)
        if last is not None and (not self._kept or _share(self._kept[-1], last) >= DRIVE_REACH[0]):
            self._kept = [*self._kept, last][-NUM_EARLIER:]

    def transform(self, T: SE3) -> None:
        """Move everything with the map."""
        self._kept = [replace(one, T=T @ one.T) for one in self._kept]
        self._last = self._last and replace(self._last, T=T @ self._last.T)

    def filled(self) -> Sphere | None:
        """Return the last sphere with the range that the drive adds to it; None without any sphere."""
        last = self._last
        if last is None:
            return None
        if last.sphere.range_std_m is None or not last.sphere.camera.is_whole:
            return last.sphere
        earlier = [one for one in self._kept if DRIVE_REACH[0] <= _share(last, one) <= DRIVE_REACH[1]]
        ranged = last.sphere.range_m.copy(), last.sphere.range_std_m.copy()
        fill_unknown(ranged, range_by_drive(last.sphere, [one.by(last) for one in earlier], self._params))
        return replace(last.sphere, range_m=ranged[0], range_std_m=ranged[1])


def range_by_drive(sphere: Sphere, earlier: Sequence[PlacedSphere], params: MatchParams) -> Ranged:
    """Return range and deviation (H, W) in m where the sphere has none, NaN where the drive does not tell either.

    With p = R' (d - x t), the point at inverse range x, by its range, in the frame of an earlier sphere at (R, t), that
    of a block minimizes S(x) = mean of (I(d) - I_earlier(p))^2; its variance is that of the levels by S'' / 2, and that
    of the motion.
    """
    step = shrinking(sphere.camera)
    whole = Spherical(sphere.camera.width // step, sphere.camera.height // step)
    baseline_m = max((float(np.linalg.norm(one.T.translation)) for one in earlier), default=0.0)
    if len(earlier) < 2 or baseline_m == 0.0:  # one alone could have seen what moved
        return np.full(sphere.range_m.shape, np.nan, np.float32), np.full(sphere.range_m.shape, np.nan, np.float32)
    rays, h = pixel_rays(whole), 1.0 / (baseline_m * whole.pixels_per_radian)
    number = int(np.clip(1.0 / (params.nearest_m * h), 4, DRIVE_HYPOTHESES))
    own, is_seen = _levels(sphere, step)
    costs = np.empty((len(earlier), number, *own.shape), np.float32)
    still = np.zeros_like(own)
    for k, one in enumerate(earlier):
        levels, is_there = _levels(one.sphere, step)
        still += _blocks(np.minimum((own - levels) ** 2, DRIVE_CAP)) / len(earlier)
        for n in range(number):
            costs[k, n] = _cost(own, is_seen, levels, is_there, _places(rays, (n - 1) * h, one.T, whole))
    x, gg, least, is_clear = _choose(costs.mean(axis=0))
    noise = 2.0 * max(params.noise / step, LEAST_NOISE) ** 2
    best = np.clip(np.rint(x), 1, number - 2).astype(np.int64)[None, None]
    each = np.take_along_axis(costs, np.repeat(best, len(earlier), axis=0), axis=1)[:, 0]
    is_good = is_clear & _has_texture_around(own) & np.all(each <= noise + MAX_RESIDUAL * gg, axis=0)
    is_good &= still >= DRIVE_CLEAR[0] * (least + DRIVE_CLEAR[1])  # otherwise it may move with the rig
    samples, excess = len(earlier) * (2 * DRIVE_BLOCK_PX + 1) ** 2, np.maximum(least - noise, 0.0)
    variance = (STD_FACTOR**2 * (noise + excess) / samples + DEPENDENT_SHARE * excess) / gg
    inverse = (x - 1) * np.float32(h)
    variance = h**2 * (variance + DRIVE_PX**2) + motion_variance(rays, inverse, earlier)
    return _ranged(inverse, np.sqrt(variance).astype(np.float32), is_good, h, sphere, params)


def shrinking(camera: Spherical) -> int:
    """Return by how much a sphere is shrunk to be compared: to DRIVE_WIDTH columns or the next size that divides it."""
    return max(k for k in range(1, max(camera.width // DRIVE_WIDTH, 1) + 1) if camera.height % k == 0)


def motion_variance(rays: Array, inverse: Plane, earlier: Sequence[PlacedSphere]) -> Array:
    """Return the variance (h, w) of inverse ranges x along rays d (h, w, 3) that the motions' covariances leave.

    T exp(v, w) moves an earlier sphere by R v and turns it by R w: the angle along the search, s the unit vector of t
    across d, changes by s . (-x R v) - s . (R w x d), and by a = |t across d| for each unit of x. Each counts by a^2.
    """
    across = [one.T.translation - (rays @ one.T.translation)[..., None] * rays for one in earlier]
    squares = np.stack([np.maximum(np.sum(t * t, axis=-1), 1e-12) for t in across])
    found = np.zeros(inverse.shape)
    for one, t, square in zip(earlier, across, squares, strict=True):
        s, R = t / np.sqrt(square)[..., None], one.T.rotation
        J = np.concatenate([-inverse[..., None] * (s @ R), np.cross(s, rays) @ R], axis=-1)
        found += (square / squares.sum(axis=0)) ** 2 * np.einsum("hwi,ij,hwj->hw", J, one.covariance, J) / square
    return found


def _ranged(inverse: Plane, std: Plane, is_good: Flags, h: float, sphere: Sphere, params: MatchParams) -> Ranged:
    """Return range and deviation at the size of the sphere, where it has none."""
    step = sphere.camera.width // inverse.shape[1]
    factor, is_good = _judge(inverse, std, is_good, h, sphere, step)
    with np.errstate(divide="ignore", invalid="ignore"):
        range_m = 1.0 / inverse
        std_m = factor * std * range_m**2
    is_far = is_good & (inverse + 2 * factor * std < 1.0 / FAR_M)
    is_near = is_good & ~is_far & (inverse > 2 * factor * std) & (std_m <= params.max_relative_std * range_m)
    found = np.where(is_far, np.inf, np.where(is_near, range_m, np.nan))
    is_open = np.isnan(sphere.range_m) & sphere.is_seen
    size = np.ones((step, step), np.float32)
    large = np.where(is_open, np.kron(found, size), np.nan).astype(np.float32)
    return large, np.where(is_open, np.kron(np.where(is_near, std_m, np.nan), size), np.nan).astype(np.float32)


def _judge(inverse: Plane, std: Plane, is_good: Flags, h: float, sphere: Sphere, step: int) -> tuple[float, Flags]:
    """Return by how much deviations are too small, and where (h, w) the drive meets what the instant measured around.

    What moves is not met: there the present images decide.
    """
    middle, std_m = (slice(step // 2, None, step),) * 2, sphere.range_std_m
    assert std_m is not None
    with np.errstate(divide="ignore", invalid="ignore"):
        known = 1.0 / sphere.range_m[middle]
        off = np.abs(inverse - known) / np.hypot(std, std_m[middle] * known**2)
    both = np.where(np.isnan(known), np.where(is_good, inverse, np.nan), known).astype(np.float32) / np.float32(h)
    is_good = is_good & ~at_jumps(both, DRIVE_EDGE_PX, is_whole=True) & ~at_unknown(both, is_whole=True)
    is_compared = is_good & np.isfinite(off)
    if np.count_nonzero(is_compared) < DRIVE_COMPARED[0]:
        return 1.0, np.zeros_like(is_good)
    factor = max(float(np.quantile(off[is_compared], DRIVE_QUANTILE[0])) / DRIVE_QUANTILE[1], 1.0)
    side, counts = DRIVE_AROUND_PX, []
    for flags in (is_compared, is_compared & (off > AGREEMENT_SIGMAS * factor)):
        wide = cv2.copyMakeBorder(flags.astype(np.float32), side, side, side, side, cv2.BORDER_WRAP)
        counts.append(cv2.boxFilter(wide, -1, (2 * side + 1,) * 2, normalize=False)[side:-side, side:-side])
    return factor, is_good & (counts[0] >= DRIVE_COMPARED[1]) & (counts[1] <= DRIVE_MISSED * counts[0])


def _levels(sphere: Sphere, step: int) -> tuple[Plane, Plane]:
    """Return levels (h, w) less their mean around, and 1 where all of it was seen."""
    height, width = sphere.camera.height // step, sphere.camera.width // step
    small = cv2.resize(sphere.gray, (width, height), interpolation=cv2.INTER_AREA)
    side = 4 * COST_RADIUS
    wide = cv2.copyMakeBorder(small, 0, 0, side, side, cv2.BORDER_WRAP)
    less = (wide - cv2.blur(wide, (2 * side + 1,) * 2))[:, side:-side]
    seen = np.asarray(sphere.is_seen.reshape(height, step, width, step).all(axis=(1, 3)), np.float32)
    return np.ascontiguousarray(less), seen


def _places(rays: Array, inverse: float, T: SE3, whole: Spherical) -> tuple[Plane, Plane]:
    """Return u, v (h, w) where an earlier sphere shows what is at an inverse range."""
    pixels = whole.project((rays - inverse * T.translation) @ T.rotation)[0]
    return pixels[..., 0].astype(np.float32), pixels[..., 1].astype(np.float32)


def _cost(own: Plane, is_seen: Plane, levels: Plane, is_there: Plane, places: tuple[Plane, Plane]) -> Plane:
    """Return the mean squared difference (h, w) of blocks, NaN where a block is not seen."""
    wide = [cv2.copyMakeBorder(plane, 0, 0, 2, 2, cv2.BORDER_WRAP) for plane in (levels, is_there)]
    there, seen = (cv2.remap(plane, places[0] + 2, places[1], cv2.INTER_LINEAR) for plane in wide)
    mean, share = _blocks(np.minimum((own - there) ** 2, DRIVE_CAP)), _blocks(is_seen * (seen > 0.99))
    mean[share < 0.99] = np.nan
    return mean


def _blocks(plane: Plane) -> Plane:
    return cv2.blur(plane.astype(np.float32), (2 * DRIVE_BLOCK_PX + 1,) * 2)


def _choose(total: Plane) -> tuple[Plane, Plane, Plane, Flags]:
    """Return hypothesis (h, w) between whole ones, S'' / 2 there, the least cost, and whether none elsewhere is as low.

    total (K, h, w): cost of each hypothesis, NaN where an earlier sphere does not see it.
    """
    filled, rows = np.where(np.isnan(total), NEVER, total), np.arange(len(total))[:, None, None]
    best = np.clip(filled.argmin(axis=0), 1, len(total) - 2)[None]
    before, least, after = (np.take_along_axis(filled, best + off, axis=0)[0] for off in (-1, 0, 1))
    gg = np.maximum(0.5 * (before + after - 2 * least), np.float32(1e-6))
    x = (best[0] + 0.25 * (before - after) / gg).astype(np.float32)
    elsewhere = np.where(np.abs(rows - best) > 2, filled, NEVER).min(axis=0)
    is_clear = (np.maximum(before, after) < NEVER) & (np.abs(x - best[0]) <= 1)
    return x, gg, least, is_clear & (elsewhere >= DRIVE_CLEAR[0] * (least + DRIVE_CLEAR[1]))


def _has_texture_around(levels: Plane) -> Flags:
    """Return where (h, w) all four quarters of a block have slopes: one at its rim would speak for all of it."""
    across, down = (cv2.Sobel(levels, cv2.CV_32F, *axes, ksize=1) for axes in ((1, 0), (0, 1)))
    around, off = cv2.blur(across * across + down * down, (DRIVE_BLOCK_PX,) * 2), (DRIVE_BLOCK_PX + 1) // 2
    quarters = [np.roll(around, (v, u), axis=(0, 1)) for v in (-off, off) for u in (-off, off)]
    found: Flags = np.minimum.reduce(quarters) >= DRIVE_SIDE_SHARE * np.maximum.reduce(quarters)
    return found


def _share(a: PlacedSphere, b: PlacedSphere) -> float:
    """Return the distance of two spheres by the median range of the first."""
    some = a.sphere.range_m[::8, ::8]
    median_m = float(np.median(some[np.isfinite(some)])) if np.isfinite(some).any() else np.inf
    return float(np.linalg.norm(a.T.translation - b.T.translation)) / median_m
