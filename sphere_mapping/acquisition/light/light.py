"""The images of an instant as if all cameras had one exposure, one white balance and lenses without falloff.

Where cameras a and b see the same point under the angles t_a, t_b from their axes, its levels I there are those of
one radiance: log I_a - log I_b = e_a - e_b + V_a(t_a) - V_b(t_b), with the exposures e and the falloff
V(t) = c_1 s + c_2 s^2 + c_3 s^3, s = (t / t_max)^2 of a lens, no c above 0: no lens brightens towards its rim (Goldman
2010, eq. 3, in logarithms). The falloff is the camera's, the same in all colors and at all times; exposures are one of
each group and instant. Both are estimated at once by robust least squares, the falloff from the first instants.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from threading import Lock

import cv2
import numpy as np
from scipy.optimize import lsq_linear
from scipy.sparse import block_diag, csr_array, hstack

from sphere_mapping.acquisition.constants import (
    CORRELATED_DIRECTIONS,
    EXPOSURE_STD,
    FALLOFF_STD,
    GRID_STEP,
    HIGHLIGHTS,
    LEAST_COEFFICIENT,
    LEVEL_STD,
    LIKE_STD,
    LOSS_SCALES,
    MAX_WHITE_BALANCE,
    MIN_FALLOFF,
    NUM_INSTANTS,
    RATIO_STD,
    WHITE,
)
from sphere_mapping.acquisition.stitching.overlaps import Overlaps, Shared, off_axis
from sphere_mapping.acquisition.stitching.views import RigView
from sphere_nav.estimation.least_squares import cauchy_weights
from sphere_nav.geometry.arrays import Array, Bytes, Floats, Integers

NUM_POWERS = 3


@dataclass(frozen=True, eq=False)
class PairRatios:
    """What two cameras say of a point: numbers of cameras and exposures, s (2, N); log ratio (N,), its deviation."""

    cameras: Integers
    exposures: Integers
    squares: Array
    ratio: Array
    std: Array


def std_of(first: Array, second: Array) -> Array:
    """Return the deviation (N,) of the logarithm of the ratio of grey levels (N,)."""
    return np.sqrt(RATIO_STD**2 + np.square(LEVEL_STD / first) + np.square(LEVEL_STD / second))


def falloff(coefficients: Array, squares: Array) -> Array:
    """Return V (...,) at s (...,), from coefficients (NUM_POWERS,)."""
    return np.polyval([*coefficients[::-1], 0.0], squares)


class Falloff:
    """The falloff of all cameras, by what instants have said of it so far.

    kinds: (number of cameras,), equal where lenses are of one kind.
    """

    def __init__(self, kinds: Sequence[object]) -> None:
        self.coefficients = np.zeros((len(kinds), NUM_POWERS))
        alike = np.array([[one == other for other in kinds] for one in kinds], np.float64)
        apart = np.diag(alike.sum(axis=1)) - alike  # x' apart x: squared differences of lenses of one kind
        size = self.coefficients.size
        self._prior = np.eye(size) / FALLOFF_STD**2 + np.kron(apart, np.eye(NUM_POWERS)) / LIKE_STD**2
        self._seen: list[PairRatios] = []

    def update(self, seen: PairRatios, num_exposures: int) -> None:
        """Add what an instant says, whose exposures are its own."""
        self._seen.append(seen)
        exposures = block_diag([design(one, num_exposures) for one in self._seen], format="csr")
        rows = hstack([np.concatenate([self._powers(one) for one in self._seen]), exposures], format="csr")
        ratio, std = (np.concatenate([getattr(one, name) for one in self._seen]) for name in ("ratio", "std"))
        size, count = self.coefficients.size, exposures.shape[1]
        prior = block_diag([self._prior, np.eye(count) / EXPOSURE_STD**2]).toarray()
        low, high = np.full(size + count, -np.inf), np.full(size + count, np.inf)
        low[:size], high[:size] = LEAST_COEFFICIENT, 0.0
        self.coefficients = descend(rows, ratio, std, prior, (low, high))[:size].reshape(-1, NUM_POWERS)

    def exposures(self, seen: PairRatios, num_exposures: int) -> Array:
        """Return the logarithms (num_exposures,) of an instant's exposures, mean 0, as the falloff is known now."""
        ratio = seen.ratio - self._powers(seen) @ self.coefficients.ravel()
        prior, free = np.eye(num_exposures) / EXPOSURE_STD**2, np.full(num_exposures, np.inf)
        values = descend(csr_array(design(seen, num_exposures)), ratio, seen.std, prior, (-free, free))
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


def descend(rows: csr_array, ratio: Array, std: Array, prior: Array, bounds: tuple[Array, Array]) -> Array:
    """Return what explains ratios (N,) by rows (N, M) best, Cauchy's loss narrowed.

    prior: information (M, M) about 0.
    """
    values: Array = np.zeros(rows.shape[1])
    for scale in LOSS_SCALES:
        weight = cauchy_weights(np.square((ratio - rows @ values) / (scale * std))) / (CORRELATED_DIRECTIONS * std**2)
        upper = np.linalg.cholesky(prior + (rows.T @ rows.multiply(weight[:, None])).toarray()).T
        target = np.linalg.solve(upper.T, rows.T @ (weight * ratio))
        values = lsq_linear(upper, target, bounds, method="bvls").x
    return values


def apply_gain(image: Bytes, gain: Array) -> Bytes:
    """Return the image (h, w[, 3]) times its gain (channels,); what is white stays white."""
    if np.all(np.abs(gain - 1.0) < 1e-3):
        return image
    before = np.arange(256)[:, None]
    after = before * gain
    rise = (before - WHITE) / (255 - WHITE)
    after = np.where((rise > 0) & (gain < 1.0), WHITE * gain + rise * (255 - WHITE * gain), after)
    levels = np.clip(np.rint(after), 0, 255).astype(np.uint8)
    return cv2.LUT(image, levels.reshape(1, 256, -1)).reshape(image.shape)


Learned = tuple[Array, dict[str, Floats]]  # coefficients of the falloff, and `Light._coarse`


class Light:
    """Learns the falloff of a rig's lenses from its first instants, and finds the gains of every instant anew.

    groups: by camera, who shares an exposure. max_gain: largest factor of an exposure over the mean of all.
    """

    def __init__(
        self, rig_views: Sequence[RigView], groups: Mapping[str, str], distance_m: float, max_gain: float
    ) -> None:
        self._rig_views = {rig_view.name: rig_view for rig_view in rig_views}
        self._names, self._max_gain = list(self._rig_views), max_gain
        self._kinds = sorted(set(groups.values()))
        self._group = [self._kinds.index(groups[name]) for name in self._names]
        self._overlaps = Overlaps(rig_views, distance_m)
        self._angles, self._largest = zip(*(_angles(rig_view) for rig_view in rig_views), strict=True)
        self.falloff = Falloff([_kind(rig_view) for rig_view in rig_views])
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
        return PairRatios(shared.cameras, groups, squares, logs[0] - logs[1], std_of(*np.exp(logs)))

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
        gray, most, apart = logs.mean(axis=1, keepdims=True), 0.5 * np.log(self._max_gain), np.log(MAX_WHITE_BALANCE)
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


def _kind(rig_view: RigView) -> tuple[object, ...]:
    """Return what lenses of one kind have in common: model, size, and focal length within some percent."""
    camera = rig_view.camera
    return type(camera), camera.width, camera.height, round(float(np.log(camera.pixels_per_radian)) / 0.05)
