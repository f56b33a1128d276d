"""The least-squares problem of one pyramid level: chosen pixels of all views, one pose, a gain and bias each.

A view knows the camera that sees it and where that is on the body (M15 eq. 8, 19): several cameras, fixed to one
another, are more views (`RigImage`). What is known of the pose before any image is seen is one more observation in the
normal equations (`Expectation`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sphere_nav.estimation.kernels import SIGMA_OF_MAD
from sphere_nav.estimation.least_squares import HUBER, scaled_inverse
from sphere_nav.geometry import SE3, Camera, FrameMotion
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.photometric.align.descent import kernels
from sphere_nav.photometric.constants import EXPECTED_SIGMAS, MIN_SIGMA, OVERLAP_CELL
from sphere_nav.photometric.params import RegistrationParams
from sphere_nav.photometric.pixels.kernels import cover
from sphere_nav.photometric.pixels.pyramid import KernelCamera, Level, Pyramid, kernel_camera, kernel_motion, rolling
from sphere_nav.photometric.pixels.reference import Selection, View, choose_pixels


@dataclass(frozen=True)
class RigImage:
    """The image of one camera of a rig, with the references that it is compared with.

    T_body_camera None: the camera is the body. `name` tells the cameras of a rig apart.
    """

    pyramid: Pyramid
    T_body_camera: SE3 | None = None
    views: tuple[View, ...] = ()
    name: str = ""

    @property
    def mount(self) -> SE3:
        """T_body_camera of any camera."""
        return self.T_body_camera or SE3.identity()

    def level(self, index: int) -> Level:
        """Return a level of the pyramid, the coarsest where it has fewer."""
        return self.pyramid.levels[min(index, len(self.pyramid.levels) - 1)]

    def pose(self, T_world_body: SE3) -> SE3:
        """Return T_world_camera."""
        return T_world_body @ self.mount

    def body(self, T_world_camera: SE3) -> SE3:
        """Return T_world_body."""
        return T_world_camera @ self.mount.inverse()

    def motion(self, motion: FrameMotion | None) -> FrameMotion | None:
        """Return the motion of the camera within the frame by that of the body."""
        return motion and replace(motion, T_world_before=self.pose(motion.T_world_before))


@cache
def share_pixels(params: RegistrationParams, number: int) -> RegistrationParams:
    """Return the parameters of one of so many cameras."""
    return replace(params, max_pixels=max(params.max_pixels // number, 1))


def image_overlap(cameras: Sequence[Camera], views: Sequence[View], T_world_camera: SE3) -> float:
    """Return the share (0..1) of an image where some reference has range, in cells of the coarsest of its levels."""
    camera = cameras[-1]
    cells = _cells_with_rays(camera)
    covered = np.zeros_like(cells)
    T_camera_world = T_world_camera.inverse()
    image = (kernel_camera(camera), camera.width, camera.height, OVERLAP_CELL, covered)
    for view in views:
        pixels = view.reference.level_like(camera)
        T_camera_reference = T_camera_world @ view.T_world_reference
        seen = pixels.near(T_camera_reference, camera)
        cover(seen.places, seen.pool, kernel_motion(T_camera_reference.matrix), *image)
    return float(np.sum(covered & cells)) / max(float(np.sum(cells)), 1.0)


@lru_cache(maxsize=16)
def _cells_with_rays(camera: Camera) -> NDArray[np.bool_]:
    """Return which cells hold a pixel that sees anything; the corners of a fisheye image do not."""
    has_ray = ~np.isnan(pixel_rays(camera)[..., 0])
    cells = np.zeros((-(-camera.height // OVERLAP_CELL), -(-camera.width // OVERLAP_CELL)), np.bool_)
    v, u = np.nonzero(has_ray)
    cells[v // OVERLAP_CELL, u // OVERLAP_CELL] = True
    return cells


@dataclass(frozen=True, eq=False)
class Expectation:
    """Where a body is expected.

    information (6, 6) is that of xi in T_world_body @ exp(xi), zero where nothing is known. Beyond `EXPECTED_SIGMAS` it
    pulls no harder (Huber): an expectation that is wrong yields to what is seen.
    """

    T_world_body: SE3
    information: Array

    def weighted(self, factor: float) -> tuple[Array, Array, float]:
        """Return it for the kernels, where so many pixels count as one: T_body_world (3, 4), information, bound."""
        bound = EXPECTED_SIGMAS * float(np.sqrt(factor))
        return self._T_body_world, factor * self.information, bound

    def pull_at(self, T_world_body: SE3) -> tuple[Array, Array]:
        """Return what it adds at a pose to the normal equations: H (6, 6), the information that counts, and g (6,)."""
        H, g = np.zeros((6, 6)), np.zeros(6)
        kernels.add_expectation(np.ascontiguousarray(T_world_body.matrix[:3]), self.weighted(1.0), H, g)
        return H, g

    def resist(self, xi: Array, T_world_body: SE3, covariance: Array) -> Array:
        """Return what is left of a step xi (6,) by images alone from a pose; the expectation is in its covariance."""
        return xi - covariance @ self.pull_at(T_world_body)[0] @ xi

    def fuse(self, T_world_body: SE3, covariance: Array) -> tuple[SE3, Array]:
        """Return a pose by images alone, and its covariance, together with the expectation."""
        H, g = self.pull_at(T_world_body)
        if not H.any():
            return T_world_body, covariance
        together = scaled_inverse(scaled_inverse(covariance) + H)
        return T_world_body @ SE3.exp(-together @ g), together

    @cached_property
    def _T_body_world(self) -> Array:
        return np.ascontiguousarray(self.T_world_body.inverse().matrix[:3])


NO_EXPECTATION = Expectation(SE3.identity(), np.zeros((6, 6)))


MAX_VIEWS, MANY_VIEWS = 4, 24  # of an image; of several, or a multiple: kernels are compiled for each such number

ROBUST = HUBER, MIN_SIGMA  # as kernels take it


@dataclass(frozen=True)
class AlignmentState:
    """What is estimated: the pose, and a gain and bias (num_views, 2) that map grey levels to each reference's."""

    T_world_body: SE3
    light: Array

    @staticmethod
    def start(T_world_body: SE3, num_views: int) -> AlignmentState:
        """Return the first guess: the given pose, the same light."""
        return AlignmentState(T_world_body, np.tile([1.0, 0.0], (num_views, 1)))


@dataclass(frozen=True)
class Descent:
    """Where one level ended; `motion` is the last increment in pixels of the level.

    `found`: the comparison of every view just before that increment.
    """

    state: AlignmentState
    iterations: int
    motion: float
    is_determined: bool  # the image fixed every increment
    found: Sequence[ViewComparison]


@dataclass(frozen=True)
class ViewComparison:
    """One view at a state: grey levels, and the sums (NUM_SUMS,) of each piece of its pixels.

    `correlation` is (sum of reference, of current, of their product, of both squares) over the visible pixels.
    """

    T_body_reference: Array
    median: float
    mad: float
    sigma: float
    num_visible: int
    num_inliers: int
    correlation: tuple[float, ...]
    pieces: Array


@dataclass(frozen=True)
class SeenView:
    """A view with its chosen pixels, and the camera that sees it as it moved within the frame, as far as is known."""

    T_world_reference: SE3
    selection: Selection
    level: Level
    kernel_camera: KernelCamera
    T_camera_body: Array


@dataclass(frozen=True)
class Problem:
    """The views of one level, and what is known of the pose."""

    views: tuple[SeenView, ...]
    params: RegistrationParams
    expected: Expectation = NO_EXPECTATION

    @staticmethod
    def choose_pixels(
        images: Sequence[RigImage],
        index: int,
        T_world_body: SE3,
        params: RegistrationParams,
        motion: FrameMotion | None = None,
        expected: Expectation = NO_EXPECTATION,
    ) -> Problem:
        """Pick the most salient pixels that each camera sees from the guessed pose, s(.) of M15 eq. 16.

        At a level, or at its coarsest where an image has fewer.
        """
        views = []
        for image in images:
            level, T_world_camera = image.level(index), image.pose(T_world_body)
            T_camera_world, camera, within = T_world_camera.inverse(), level.camera, image.motion(motion)
            T_camera_body = rows_of(image.mount.inverse())
            moving = level.kernel_camera if within is None else rolling(camera, within.twist(T_world_camera))
            for view in image.views:
                pixels, share = view.reference.level_like(camera), params.max_pixels // len(image.views)
                chosen = choose_pixels(pixels, T_camera_world @ view.T_world_reference, camera, share)
                views.append(SeenView(view.T_world_reference, chosen, level, moving, T_camera_body))
        return Problem(tuple(views), params, expected)

    def descend(self, state: AlignmentState, limit: int, *, is_rotation: bool = False) -> Descent:
        """Iterate until the increment moves the image less than `min_step` (M15 eq. 6-7), `limit` times at most."""
        T_world_body, light = state.T_world_body.matrix[:3].copy(), state.light.copy()
        params, (facts, pieces) = self.params, self._room()
        scales = np.array([(one.level.camera.pixels_per_radian, one.selection.typical_range) for one in self.views])
        end = scales, (params.min_step, float(params.min_pixels)), limit, is_rotation
        known = ROBUST, self.expected.weighted(params.correlated_pixels)
        iterations, motion, is_determined = kernels.descend(
            self._views, T_world_body, light, *known, *end, facts, pieces
        )
        pose = np.concatenate([T_world_body, [[0.0, 0.0, 0.0, 1.0]]])
        last = AlignmentState(SE3(pose), light)
        return Descent(last, iterations, motion, is_determined, self._comparisons(last, facts, pieces))

    def compare(self, state: AlignmentState) -> tuple[Array, Array, list[ViewComparison]]:
        """Return H, g over (xi, gain 1, bias 1, ...) with H x = -g at a state (eq. 6, 31-35), and all views there."""
        facts, pieces = self._room()
        H, g, _ = kernels.linearize(self._views, rows_of(state.T_world_body), state.light, ROBUST, facts, pieces)
        return H, g, self._comparisons(state, facts, pieces)

    def _comparisons(self, state: AlignmentState, facts: Array, pieces: Array) -> list[ViewComparison]:
        """Return what `examine` has written of every view."""
        found, T_body_world = [], state.T_world_body.inverse()
        for one, own, sums in zip(self.views, facts, pieces, strict=True):
            median, mad, num_visible, num_inliers, num_pieces, *correlation = own.tolist()
            where, sigma = rows_of(T_body_world @ one.T_world_reference), max(SIGMA_OF_MAD * mad, MIN_SIGMA)
            counts, parts = (int(num_visible), int(num_inliers)), sums[: int(num_pieces)]
            found.append(ViewComparison(where, median, mad, sigma, *counts, tuple(correlation), parts))
        return found

    @property
    def _views(self) -> tuple[Any, ...]:
        """Blocks, cameras and images of the views as the kernels take them, their number, and their poses (N, 3, 4)."""
        number = len(self.views)
        rest = (MAX_VIEWS if number <= MAX_VIEWS else -(-number // MANY_VIEWS) * MANY_VIEWS) - number
        seen = [*self.views, *[self.views[0]] * rest]
        blocks = tuple(one.selection.blocks for one in seen)
        cameras, images = tuple(one.kernel_camera for one in seen), tuple(one.level.samples for one in seen)
        T_world_reference = np.stack([rows_of(one.T_world_reference) for one in self.views])
        return blocks, cameras, images, number, T_world_reference, np.stack([one.T_camera_body for one in self.views])

    def _room(self) -> tuple[Array, Array]:
        """Return room for the facts (N, NUM_FACTS) of the views and the sums of their pieces."""
        number = len(self.views)
        return np.empty((number, kernels.NUM_FACTS)), np.empty((number, kernels.NUM_PIECES, kernels.NUM_SUMS))


def rows_of(T: SE3) -> Array:
    """Return the upper rows (3, 4) of a motion, as kernels take it."""
    return np.ascontiguousarray(T.matrix[:3])
