"""The least-squares problem of one pyramid level: chosen pixels of all views, one pose, a gain and bias each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sphere_nav.estimation.kernels import SIGMA_OF_MAD
from sphere_nav.geometry import SE3, FrameMotion
from sphere_nav.geometry.arrays import Array
from sphere_nav.photometric.align.descent import kernels
from sphere_nav.photometric.align.expectation import NO_EXPECTATION, Expectation
from sphere_nav.photometric.align.projection import KernelCamera, rolling
from sphere_nav.photometric.params import RegistrationParams
from sphere_nav.photometric.pixels.pyramid import NO_FLOATS, Level
from sphere_nav.photometric.pixels.reference import Selection, View
from sphere_nav.photometric.pixels.selection import choose_pixels

MAX_VIEWS = kernels.MAX_VIEWS


@dataclass(frozen=True)
class AlignmentState:
    """What is estimated: the pose, and a gain and bias (num_views, 2) that map grey levels to each reference's."""

    T_world_camera: SE3
    light: Array

    @staticmethod
    def start(T_world_camera: SE3, num_views: int) -> AlignmentState:
        """Return the first guess: the given pose, the same light."""
        return AlignmentState(T_world_camera, np.tile([1.0, 0.0], (num_views, 1)))


@dataclass(frozen=True)
class Descent:
    """Where one level ended; `motion` is the last increment in pixels of the level.

    `found`: the comparison of every view just before that increment, where it was below `min_step`, the gradients of
    the pieces those after it; else empty.
    """

    state: AlignmentState
    iterations: int
    motion: float
    is_determined: bool  # the image fixed every increment
    found: tuple[ViewComparison, ...] = ()


@dataclass(frozen=True)
class ViewComparison:
    """One view at a state: grey levels, and the sums (NUM_SUMS,) of each piece of its pixels.

    `correlation` is (sum of reference, of current, of their product, of both squares) over the visible pixels.
    """

    T_camera_reference: Array
    median: float
    mad: float
    sigma: float
    num_visible: int
    num_inliers: int
    correlation: Array
    pieces: Array


@dataclass(frozen=True)
class Problem:
    """The views of one level with their chosen pixels; the camera as it moved within the frame, as far as is known."""

    selections: tuple[Selection, ...]
    T_world_reference: tuple[SE3, ...]
    level: Level
    params: RegistrationParams
    kernel_camera: KernelCamera

    @staticmethod
    def choose_pixels(
        level: Level,
        views: Sequence[View],
        T_world_camera: SE3,
        params: RegistrationParams,
        motion: FrameMotion | None = None,
    ) -> Problem:
        """Pick the most salient pixels that the camera sees from the guessed pose, s(.) of M15 eq. 16."""
        share = params.max_pixels // len(views)
        T_camera_world, camera = T_world_camera.inverse(), level.camera
        selections = (
            choose_pixels(view.reference.level_like(camera), T_camera_world @ view.T_world_reference, camera, share)
            for view in views
        )
        moving = level.kernel_camera if motion is None else rolling(camera, motion.twist(T_world_camera))
        return Problem(tuple(selections), tuple(view.T_world_reference for view in views), level, params, moving)

    def descend(
        self,
        state: AlignmentState,
        limit: int,
        expected: Expectation = NO_EXPECTATION,
        *,
        is_rotation: bool = False,
    ) -> Descent:
        """Iterate until the increment moves the image less than `min_step` (M15 eq. 6-7), `limit` times at most."""
        T_world_camera, light = state.T_world_camera.matrix[:3].copy(), np.ones((MAX_VIEWS, 2))
        light[: len(state.light)] = state.light
        params, (facts, pieces) = self.params, _room()
        depth = min(selection.typical_range for selection in self.selections)
        stop = (params.min_step, self.level.camera.pixels_per_radian, depth, float(params.min_pixels))
        moving, end = (T_world_camera, light), (stop, limit, is_rotation)
        known = self._robust, expected.weighted(params.correlated_pixels)
        iterations, motion, is_determined = kernels.descend(
            *self._views, *self._image, *moving, *known, *end, facts, pieces
        )
        pose = np.concatenate([T_world_camera, [[0.0, 0.0, 0.0, 1.0]]])
        last = AlignmentState(SE3(pose), light[: len(state.light)])
        is_still = is_determined and iterations > 0 and motion < params.min_step
        found = tuple(self._comparisons(last, facts, pieces)) if is_still else ()
        return Descent(last, iterations, motion, is_determined, found)

    def linearize(self, state: AlignmentState) -> tuple[Array, Array, int]:
        """Return H, g over (xi, gain 1, bias 1, ...) with H x = -g, and the number of visible pixels (eq. 6, 31-35)."""
        T_world_camera = np.ascontiguousarray(state.T_world_camera.matrix[:3])
        args = T_world_camera, state.light, self._robust
        H, g, visible = kernels.linearize(*self._views, *self._image, *args, *_room())
        return H, g, int(visible)

    def compare(self, state: AlignmentState) -> list[ViewComparison]:
        """Compare the image with every view at a state, each pixel once more."""
        T_camera_world, (facts, pieces) = state.T_world_camera.inverse(), _room()
        for index, (selection, T_world_reference) in enumerate(
            zip(self.selections, self.T_world_reference, strict=True)
        ):
            T = np.ascontiguousarray((T_camera_world @ T_world_reference).matrix[:3])
            light = state.light[index].tolist()
            kernels.examine(selection.blocks, T, *self._image, *light, *self._robust, facts[index], pieces[index])
        return self._comparisons(state, facts, pieces)

    def _comparisons(self, state: AlignmentState, facts: Array, pieces: Array) -> list[ViewComparison]:
        """Return what `examine` has written of every view."""
        T_camera_world, found = state.T_world_camera.inverse(), []
        for index, T_world_reference in enumerate(self.T_world_reference):
            median, mad, num_visible, num_inliers, num_pieces, *_ = facts[index].tolist()
            sigma = max(SIGMA_OF_MAD * mad, self.params.min_sigma)
            T = np.ascontiguousarray((T_camera_world @ T_world_reference).matrix[:3])
            sums = facts[index, kernels.SUM_REFERENCE :], pieces[index, : int(num_pieces)]
            found.append(ViewComparison(T, median, mad, sigma, int(num_visible), int(num_inliers), *sums))
        return found

    @property
    def _views(self) -> tuple[tuple[NDArray[np.float32], ...], int, Array]:
        blocks = [selection.blocks for selection in self.selections]
        T_world_reference = np.stack([T.matrix[:3] for T in self.T_world_reference])
        return (*blocks, *[NO_FLOATS] * (MAX_VIEWS - len(blocks))), len(blocks), T_world_reference

    @property
    def _image(self) -> tuple[object, object]:
        return self.kernel_camera, self.level.samples

    @property
    def _robust(self) -> tuple[float, float]:
        return self.params.huber, self.params.min_sigma


def _room() -> tuple[Array, Array]:
    """Return room for the facts (MAX_VIEWS, NUM_FACTS) of views and the sums of their pieces."""
    return np.empty((MAX_VIEWS, kernels.NUM_FACTS)), np.empty((MAX_VIEWS, kernels.NUM_PIECES, kernels.NUM_SUMS))
