"""READ FIRST for whether a refined camera is believed: each half of the drive is judged by the other one.

A lens that fits the images it was found by proves nothing. The drive is cut in two. What one half finds must explain
the images of the other half better than the given lens does (a likelihood ratio, robust, pose and light of each image
adjusted under either lens), and both halves must find about the same. Consecutive images err alike, so that evidence
and scatter are counted by runs of images, with Student's t. Where either fails the given lens stays.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.special import huber, ndtr, stdtrit

from rig_calibration.constants import (
    APART,
    LENS_GRID,
    LENS_STEPS,
    MIN_HALF,
    MIN_OWN_STEP,
    MIN_PIXELS,
    MIN_SIGMA,
    NUM_RUNS,
    SIGMAS,
)
from rig_calibration.drive.drive_image import DriveImage, ImageState, differentiate, weigh_part
from rig_calibration.drive.drive_lens import MAP, Lens
from rig_calibration.drive.refinement import RefinedCamera, refine_camera
from sphere_nav.estimation.least_squares import HUBER, RARE, weigh
from sphere_nav.geometry import so3
from sphere_nav.geometry.arrays import Array


@dataclass(frozen=True, eq=False)
class LensProof:
    """What a drive found, and what its halves say of it."""

    found: RefinedCamera
    halves: tuple[Lens, Lens]
    evidence: float  # Student's t of the held-out likelihood ratio against the given lens
    limit: float  # that it must exceed
    moved_px: float  # rms over the image, between the given lens and what the halves found
    apart_px: float  # the same between both halves
    max_readout: float  # s, the time between two images

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why it is refused; empty where it is accepted."""
        near, readout = APART * self.moved_px, self.found.lens.readout
        checks = (
            (
                self.evidence >= self.limit,
                "held-out images: expected what one half of the drive finds to explain the other half better than the "
                f"given lens, t >= {self.limit:.1f} (false alarm {RARE:.1%}), found {self.evidence:.1f}",
            ),
            (
                self.apart_px <= near,
                f"halves of the drive: expected lenses within {near:.2f} px of each other, half of how far they are "
                f"off the given one, found {self.apart_px:.2f} px",
            ),
            (
                readout <= self.max_readout,
                f"readout: expected at most {1e3 * self.max_readout:.1f} ms, the time between two images, "
                f"found {1e3 * readout:.1f} ms",
            ),
        )
        return tuple(text for is_good, text in checks if not is_good)

    @property
    def unobserved(self) -> tuple[str, ...]:
        """Parameters of the camera that the drive does not tell."""
        return tuple(name for name in self.found.unobserved if name in self.found.lens.names[:MAP])


def prove(
    images: Sequence[DriveImage],
    given: Lens,
    max_readout: float = np.inf,
    progress: Callable[[], object] = lambda: None,
) -> LensProof:
    """Refine the camera by a drive and judge each half by the other one.

    Images in the order of the drive. What the drive does not tell stays as it was given. ValueError with fewer images
    than six.
    """
    if len(images) < 2 * MIN_HALF:
        expected = f"expected at least {2 * MIN_HALF} images that are localised, three a half"
        raise ValueError(f"drive: {expected}, found {len(images)}")
    given = given.beside_map(any(image.T_map_optical is not None for image in images))
    refine = partial(refine_camera, progress=progress)
    found = refine(images, given, num_blocks=2 * NUM_RUNS)
    held = tuple(name for name in found.unobserved if name in given.names[:MAP])
    if held:
        found = refine(images, given, (found.lens, found.states), held, 2 * NUM_RUNS)
    middle = len(images) // 2
    parts = [(images[:middle], found.states[:middle]), (images[middle:], found.states[middle:])]
    halves = [refine(part, given, (found.lens, states), held).lens for part, states in parts]
    gains = [
        run.mean()
        for (part, states), lens in zip(parts, reversed(halves), strict=True)
        for run in np.array_split(likelihood_ratio(part, states, given, lens), min(NUM_RUNS, len(part)))
    ]
    deviation = max(float(np.std(gains, ddof=1)) / np.sqrt(len(gains)), 1e-12)
    speed = float(np.sqrt(np.mean([speed_in_image(image, given) ** 2 for image in images])))
    moved = [lens_distance(given, lens, speed) for lens in halves]
    return LensProof(
        _widen(found, halves, len(gains), held),
        (halves[0], halves[1]),
        float(np.mean(gains)) / deviation,
        float(stdtrit(len(gains) - 1, 1.0 - RARE)),
        float(np.mean(moved)),
        lens_distance(halves[0], halves[1], speed),
        max_readout,
    )


def _widen(found: RefinedCamera, halves: Sequence[Lens], num_runs: int, held: Sequence[str]) -> RefinedCamera:
    """Return what was found with the covariance of few runs, and as wide as the halves differ; `held` as before."""
    few = float(stdtrit(num_runs - 1, ndtr(SIGMAS))) / SIGMAS
    off = 0.5 * (halves[0].values - halves[1].values)
    covariance = few**2 * found.covariance + np.outer(off, off)
    is_held = np.array([name in held for name in found.lens.names])
    covariance[is_held] = covariance[:, is_held] = 0.0
    covariance[is_held, is_held] = found.prior_sigma[is_held] ** 2
    return replace(found, covariance=covariance)


def likelihood_ratio(images: Sequence[DriveImage], states: Sequence[ImageState], given: Lens, lens: Lens) -> Array:
    """Return by how much a pixel of each image (N,) is likelier, in the mean, under `lens` than under `given`.

    The negative logarithm of Huber's likelihood; both by the same scale, the residuals' under the given lens. In the
    map as it is: that is what will be driven in, whatever the lens that made it.
    """
    given, lens = given.beside_map(False), lens.beside_map(False)
    gains = np.zeros(len(images))
    for k, (image, state) in enumerate(zip(images, states, strict=True)):
        before, after = (settle_image(image, state, one) for one in (given, lens))
        if min(len(before), len(after)) >= MIN_PIXELS:
            _, sigma = weigh(before, MIN_SIGMA)
            gains[k] = _cost(before, sigma) - _cost(after, sigma)
    return gains


def settle_image(image: DriveImage, state: ImageState, lens: Lens) -> Array:
    """Return the residuals (N,) of an image under a lens, its pose and light adjusted from coarse to full size."""
    for level in reversed(range(len(image.levels[:2]))):
        least = np.inf
        for _ in range(LENS_STEPS):
            residual, J = differentiate(image, state, lens, level)
            part = weigh_part(residual, J[:, len(lens.names) :])
            cost = _cost(residual, part.sigma)
            if part.num_pixels == 0 or cost > (1.0 - MIN_OWN_STEP) * least:
                break
            step = -np.linalg.solve(part.H + 1e-9 * np.eye(len(part.g)), part.g)
            least, state = cost, state.moved(np.asarray(step, np.float64))
    return differentiate(image, state, lens, 0)[0]


def _cost(residual: Array, sigma: float) -> float:
    """Return the mean of Huber's rho of residuals (N,) over sigma."""
    return float(np.mean(huber(HUBER, residual / sigma)))


def lens_distance(a: Lens, b: Lens, speed: float = 0.0) -> float:
    """Return by how many pixels (rms over the image) two lenses differ, less what a turn of the camera undoes.

    Their readouts count by how far rows move at an image speed in px/s.
    """
    u, v = (np.linspace(0, size - 1, n) for size, n in zip((a.camera.width, a.camera.height), LENS_GRID, strict=True))
    pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    rays = np.stack([one.camera.unproject(pixels) for one in (a, b)])
    known = np.all(np.isfinite(rays), axis=(0, 2))
    ours, theirs = rays[:, known]
    turned = ours @ so3.nearest_rotations(theirs.T @ ours).T
    off = np.linalg.norm(b.camera.project(turned)[0] - pixels[known], axis=1)
    rows = speed * (a.readout - b.readout) / np.sqrt(12.0)  # rms of shares that are even in -1/2...1/2
    return float(np.sqrt(np.nanmean(off**2) + rows**2))


def speed_in_image(image: DriveImage, lens: Lens) -> float:
    """Return how fast an image moves, in px/s, by its velocity and the typical distance of what it shows."""
    points = image.levels[-1].points_map - image.T_map_camera.translation
    way, turn = np.linalg.norm(image.velocity.reshape(2, 3), axis=1)
    near = float(np.median(np.linalg.norm(points, axis=1))) if len(points) else np.inf
    return float(lens.camera.pixels_per_radian * np.hypot(turn, way / near))
