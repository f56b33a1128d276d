"""The images of an instant as if all cameras had one exposure, one white balance and lenses without falloff.

Where cameras a and b see the same point under the angles t_a, t_b from their axes, its levels I there are those of
one radiance: log I_a - log I_b = e_a - e_b + V_a(t_a) - V_b(t_b), with the exposures e and the falloff
V(t) = c_1 s + c_2 s^2 + c_3 s^3, s = (t / t_max)^2 of a lens (Goldman 2010, eq. 3, in logarithms). The falloff is the
camera's, the same in all colors and at all times; exposures are one of each group and instant. Both are estimated at
once by robust least squares, the falloff from the first instants.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from threading import Lock

import cv2
import numpy as np
from scipy.sparse import block_diag, csr_array, hstack

from sphere_mapping.acquisition.constants import (
    EXPOSED,
    EXPOSURE_STD,
    FALLOFF_STD,
    GRID_STEP,
    HIGHLIGHTS,
    LOSS_SCALES,
    MAX_GAIN,
    MAX_SHARED,
    MAX_WHITE_BALANCE,
    MIN_FALLOFF,
    MIN_MATCHES,
    NUM_CORRELATED,
    NUM_INSTANTS,
    OVERLAP_CELL,
    OVERLAP_GRID,
    RATIO_STD,
    VERY_FAR_M,
)
from sphere_mapping.acquisition.stitching.views import RigView
from sphere_nav.estimation.least_squares import cauchy_weights
from sphere_nav.geometry.arrays import Array, Bytes, Floats, Integers
from sphere_nav.geometry.cameras.camera import pixel_rays

NUM_POWERS = 3


@dataclass(frozen=True, eq=False)
class Overlap:
    """Two cameras by number; angles (2, N) in rad and pixels u, v, (1, N) each, of the directions that both see."""

    cameras: tuple[int, int]
    angles: Array
    pixels: tuple[tuple[Floats, Floats], tuple[Floats, Floats]]


@dataclass(frozen=True, eq=False)
class Shared:
    """What pairs of cameras have in common: their numbers (2, N), angles (2, N) in rad, levels (2, N, channels)."""

    cameras: Integers
    angles: Array
    levels: Array


class Overlaps:
    """Where two cameras of a rig see the same directions, everything taken at one distance (0: very far).

    Parallax and time put other things into one direction: whoever uses what they have there must be robust.
    """

    def __init__(self, rig_views: Sequence[RigView], distance_m: float) -> None:
        rays = pixel_rays(OVERLAP_GRID) * (distance_m or VERY_FAR_M)
        self._steps = [_step(rig_view) for rig_view in rig_views]
        is_inside = [rig_view.project(rays)[2] > 2 * OVERLAP_CELL for rig_view in rig_views]
        rows = (np.arange(OVERLAP_GRID.height)[:, None] + 0.5) * np.pi / OVERLAP_GRID.height
        is_even = np.random.default_rng(0).random((OVERLAP_GRID.height, OVERLAP_GRID.width)) < np.sin(rows)
        self.pairs = []
        for pair in combinations(range(len(rig_views)), 2):
            points = rays[is_inside[pair[0]] & is_inside[pair[1]] & is_even]
            if len(points) >= MIN_MATCHES:
                chosen = points[None, :: -(-len(points) // MAX_SHARED)]
                views = [rig_views[k] for k in pair]
                angles = [off_axis(view.T_sphere_camera.inverse().apply(chosen[0])) for view in views]
                first, second = (_pixels_of(rig_views[k], chosen, self._steps[k]) for k in pair)
                self.pairs.append(Overlap(pair, np.stack(angles), (first, second)))

    def compare(self, images: Mapping[int, Bytes]) -> Shared | None:
        """Return what pairs of the images (h, w[, 3]) by number of the camera have in common; None: nothing."""
        small = {k: _shrink(image, self._steps[k]) for k, image in images.items()}
        found, (low, high) = [], EXPOSED
        for pair in self.pairs:
            if set(pair.cameras) <= set(images):
                drawn = [
                    cv2.remap(small[k], *pixels, cv2.INTER_LINEAR)
                    for k, pixels in zip(pair.cameras, pair.pixels, strict=True)
                ]
                levels = np.stack(drawn).reshape(2, pair.angles.shape[1], -1).astype(np.float64)
                good = np.all((levels > low) & (levels < high), axis=(0, 2))
                if (number := np.count_nonzero(good)) >= MIN_MATCHES:
                    cameras = np.repeat(np.array(pair.cameras)[:, None], number, axis=1)
                    found.append((cameras, pair.angles[:, good], levels[:, good]))
        return Shared(*(np.concatenate(parts, axis=1) for parts in zip(*found, strict=True))) if found else None


def off_axis(points: Array) -> Array:
    """Return the angle (...,) in rad between the optical axis and points (..., 3) of a camera's frame; NaN for NaN."""
    return np.arctan2(np.linalg.norm(points[..., :2], axis=-1), points[..., 2])


def _step(rig_view: RigView) -> int:
    camera = rig_view.camera
    return max(min(round(camera.pixels_per_radian * OVERLAP_CELL), camera.width, camera.height), 1)


def _pixels_of(rig_view: RigView, points: Array, step: int) -> tuple[Floats, Floats]:
    """Return u, v of points (h, w, 3) in a camera's image whose pixels are `step` times as large."""
    half, (u, v, _) = np.float32(0.5), rig_view.project(points)
    return (u + half) / np.float32(step) - half, (v + half) / np.float32(step) - half


def _shrink(image: Bytes, step: int) -> Floats:
    """Return the image with pixels `step` times as large; a whole number of pixels each, which is much faster."""
    height, width = image.shape[0] // step, image.shape[1] // step
    whole = image[: height * step, : width * step]
    return cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA).astype(np.float32)


@dataclass(frozen=True, eq=False)
class PairRatios:
    """What two cameras say of a point: numbers of cameras and exposures, s (2, N); log ratio (N,)."""

    cameras: Integers
    exposures: Integers
    squares: Array
    ratio: Array


def falloff(coefficients: Array, squares: Array) -> Array:
    """Return V (...,) at s (...,), from coefficients (NUM_POWERS,)."""
    return np.polyval([*coefficients[::-1], 0.0], squares)


class Falloff:
    """The falloff of so many cameras, by what instants have said of it so far."""

    def __init__(self, number: int) -> None:
        self.coefficients = np.zeros((number, NUM_POWERS))
        self._seen: list[PairRatios] = []

    def update(self, seen: PairRatios, num_exposures: int) -> None:
        """Add what an instant says, whose exposures are its own."""
        self._seen.append(seen)
        exposures = block_diag([design(one, num_exposures) for one in self._seen], format="csr")
        rows = hstack([np.concatenate([self._powers(one) for one in self._seen]), exposures], format="csr")
        ratio = np.concatenate([one.ratio for one in self._seen])
        size, count = self.coefficients.size, exposures.shape[1]
        deviations = np.repeat([FALLOFF_STD, EXPOSURE_STD], [size, count])
        self.coefficients = descend(rows, ratio, deviations)[:size].reshape(-1, NUM_POWERS)

    def exposures(self, seen: PairRatios, num_exposures: int) -> Array:
        """Return the logarithms (num_exposures,) of an instant's exposures, mean 0, as the falloff is known now."""
        ratio = seen.ratio - self._powers(seen) @ self.coefficients.ravel()
        deviations = np.full(num_exposures, EXPOSURE_STD)
        values = descend(csr_array(design(seen, num_exposures)), ratio, deviations)
        return values - values.mean()

    def _powers(self, seen: PairRatios) -> Array:
        """Return the derivatives (N, cameras * NUM_POWERS) of the ratios by all coefficients."""
        powers = np.stack([seen.squares[k] ** power for k in range(2) for power in range(1, NUM_POWERS + 1)], axis=-1)
        found = np.zeros((seen.ratio.size, *self.coefficients.shape))
        at = np.arange(seen.ratio.size)
        found[at, seen.cameras[0]] += powers[:, :NUM_POWERS]
        found[at, seen.cameras[1]] -= powers[:, NUM_POWERS:]
        return found.reshape(seen.ratio.size, -1)


def design(seen: PairRatios, num_exposures: int) -> Array:
    """Return the derivatives (N, num_exposures) of the ratios by the exposures; none within one exposure."""
    alone = np.eye(num_exposures)
    return alone[seen.exposures[0]] - alone[seen.exposures[1]]


def descend(rows: csr_array, ratio: Array, deviations: Array) -> Array:
    """Return what explains ratios (N,) by rows (N, M) best, Cauchy's loss narrowed.

    deviations: (M,), about 0, before anything is seen.
    """
    values: Array = np.zeros(rows.shape[1])
    for scale in LOSS_SCALES:
        weight = cauchy_weights(np.square((ratio - rows @ values) / (scale * RATIO_STD)))
        weight = weight / (NUM_CORRELATED * RATIO_STD**2)
        information = np.diag(1.0 / deviations**2) + (rows.T @ rows.multiply(weight[:, None])).toarray()
        values = np.linalg.solve(information, rows.T @ (weight * ratio))
    return values


def apply_gain(image: Bytes, gain: Array) -> Bytes:
    """Return the image (h, w[, 3]) times its gain (channels,); what is white stays white."""
    if np.all(np.abs(gain - 1.0) < 1e-3):
        return image
    before, white = np.arange(256)[:, None], EXPOSED[1]
    after = before * gain
    rise = (before - white) / (255 - white)
    after = np.where((rise > 0) & (gain < 1.0), white * gain + rise * (255 - white * gain), after)
    levels = np.clip(np.rint(after), 0, 255).astype(np.uint8)
    return cv2.LUT(image, levels.reshape(1, 256, -1)).reshape(image.shape)


Learned = tuple[Array, dict[str, Floats]]  # coefficients of the falloff, and `Light._coarse`


class Light:
    """Learns the falloff of a rig's lenses from its first instants, and finds the gains of every instant anew.

    groups: by camera, who shares an exposure.
    """

    def __init__(self, rig_views: Sequence[RigView], groups: Mapping[str, str], distance_m: float) -> None:
        self._rig_views = {rig_view.name: rig_view for rig_view in rig_views}
        self._names = list(self._rig_views)
        self._kinds = sorted(set(groups.values()))
        self._group = [self._kinds.index(groups[name]) for name in self._names]
        self._overlaps = Overlaps(rig_views, distance_m)
        self._angles, self._largest = zip(*(_angles(rig_view) for rig_view in rig_views), strict=True)
        self.falloff = Falloff(len(rig_views))
        self._num_seen, self._lock = 0, Lock()
        self._factors: dict[str, Floats] = {}  # by which an image is multiplied
        self._coarse: dict[str, Floats] = {}  # the same, one number for `GRID_STEP` px

    @property
    def is_settled(self) -> bool:
        """Whether nothing more is learned."""
        return self._num_seen >= NUM_INSTANTS

    @property
    def learned(self) -> Learned:
        """What other processes need to go on alike."""
        return self.falloff.coefficients, dict(self._coarse)

    def resume(self, learned: Learned) -> None:
        """Take over what another one has learned, all of it."""
        self.falloff.coefficients, factors = learned
        self._num_seen = NUM_INSTANTS
        for name, factor in factors.items():
            self._use(name, factor)

    def balance(self, images: Mapping[str, Bytes]) -> tuple[dict[str, Bytes], dict[str, Array]]:
        """Return the images (h, w[, 3]) with light made equal, and the gain (channels,) of each camera."""
        channels = 1 if next(iter(images.values())).ndim == 2 else 3
        gains = np.ones((len(self._kinds), channels))
        shared = self._overlaps.compare({k: images[name] for k, name in enumerate(self._names) if name in images})
        if shared is not None:
            seen = [self._comparison(shared, color) for color in range(channels)]
            with self._lock:
                if self._num_seen < NUM_INSTANTS:
                    self._learn(self._comparison(shared, slice(None)))
            gains = self._gains(seen)
            gains *= self._headroom(images, gains)
        found = {name: gains[self._group[self._names.index(name)]] for name in images}
        return {name: self._apply(image, name, found[name]) for name, image in images.items()}, found

    def _comparison(self, shared: Shared, colors: int | slice) -> PairRatios:
        """Return what all overlaps say of grey levels: the mean of the logarithms of some of their colours."""
        logs = np.log(shared.levels)[..., colors].reshape(*shared.cameras.shape, -1).mean(axis=2)
        squares = np.square(shared.angles / np.array(self._largest)[shared.cameras])
        groups = np.array(self._group)[shared.cameras]
        return PairRatios(shared.cameras, groups, squares, logs[0] - logs[1])

    def _learn(self, seen: PairRatios) -> None:
        self.falloff.update(seen, len(self._kinds))
        self._num_seen += 1
        for k, name in enumerate(self._names):
            largest = float(seen.squares[seen.cameras == k].max(initial=0.0))
            squares = np.minimum(np.square(self._angles[k] / self._largest[k]), largest)  # beyond, nothing is known
            factor = np.exp(-falloff(self.falloff.coefficients[k], squares)).astype(np.float32)
            self._use(name, factor)

    def _use(self, name: str, factor: Floats) -> None:
        camera = self._rig_views[name].camera
        self._coarse[name] = factor
        self._factors[name] = cv2.resize(factor, (camera.width, camera.height)).astype(np.float32)

    def _gains(self, seen: Sequence[PairRatios]) -> Array:
        """Return the factor (groups, channels) of each exposure, its colours by `MAX_WHITE_BALANCE` apart at most."""
        logs = np.column_stack([-self.falloff.exposures(color, len(self._kinds)) for color in seen])
        gray, most, apart = logs.mean(axis=1, keepdims=True), 0.5 * np.log(MAX_GAIN), np.log(MAX_WHITE_BALANCE)
        return np.exp(np.clip(gray, -most, most) + np.clip(logs - gray, -apart, apart))

    def _headroom(self, images: Mapping[str, Bytes], gains: Array) -> float:
        """Return a common factor of at most 1: no camera that another one outshines loses its own highlights."""
        allowed, (percentile, bright) = 1.0, HIGHLIGHTS
        for name, image in images.items():
            gain = float(gains[self._group[self._names.index(name)]].max())
            brightest = float(np.percentile(image[::GRID_STEP, ::GRID_STEP], percentile))
            allowed = min(allowed, max(bright / max(brightest, 1.0), 1.0) / gain)
        return allowed

    def _apply(self, image: Bytes, name: str, gain: Array) -> Bytes:
        factor, even = self._factors.get(name), apply_gain(image, gain)
        if factor is None or float(factor.max()) < 1.0 + MIN_FALLOFF:
            return even
        factor = factor if image.ndim == 2 else cv2.merge([factor] * 3)
        return cv2.multiply(even, factor, dtype=cv2.CV_8U).astype(np.uint8)


def _angles(rig_view: RigView) -> tuple[Array, float]:
    """Return the angle (h / GRID_STEP, w / GRID_STEP) in rad from the optical axis, and the largest one of use."""
    camera = rig_view.camera
    size = max(camera.width // GRID_STEP, 1), max(camera.height // GRID_STEP, 1)
    u, v = (
        ((np.arange(n) + 0.5) * whole / n - 0.5) for n, whole in zip(size, (camera.width, camera.height), strict=True)
    )
    angle = off_axis(camera.unproject(np.stack(np.meshgrid(u, v), axis=-1)))
    is_usable = (cv2.resize(rig_view.border, size, interpolation=cv2.INTER_NEAREST) > 0) & np.isfinite(angle)
    return np.nan_to_num(angle, nan=np.pi), float(angle[is_usable].max()) if is_usable.any() else 1.0
