"""The least-squares problem of one pyramid level: chosen pixels of all views, one pose, a gain and bias each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from photometric.descent import kernels
from photometric.params import RegistrationParams
from photometric.projection import KernelCamera, rolling
from photometric.pyramid import NO_FLOATS, Level
from photometric.reference import Selection, View
from photometric.selection import choose
from sphere_geometry import SE3, FrameMotion

Array = NDArray[np.float64]
MAX_VIEWS = kernels.MAX_VIEWS


@dataclass(frozen=True)
class State:
    """What is estimated: the pose, and a gain and bias (num_views, 2) that map grey levels to each reference's."""

    T_world_camera: SE3
    light: Array

    @staticmethod
    def start(T_world_camera: SE3, num_views: int) -> State:
        """Return the first guess: the given pose, the same light."""
        return State(T_world_camera, np.tile([1.0, 0.0], (num_views, 1)))


@dataclass(frozen=True)
class Descent:
    """Where one level ended; `motion` is the last increment in pixels of the level."""

    state: State
    iterations: int
    motion: float
    is_determined: bool  # the image fixed every increment


@dataclass(frozen=True)
class Comparison:
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
            choose(view.reference.level_like(camera), T_camera_world @ view.T_world_reference, camera, share)
            for view in views
        )
        moving = level.kernel_camera if motion is None else rolling(camera, motion.twist(T_world_camera))
        return Problem(tuple(selections), tuple(view.T_world_reference for view in views), level, params, moving)

    def descend(self, state: State, limit: int, is_rotation: bool = False) -> Descent:
        """Iterate until the increment moves the image less than `min_step` (M15 eq. 6-7), `limit` times at most."""
        T_world_camera, light = state.T_world_camera.matrix[:3].copy(), np.ones((MAX_VIEWS, 2))
        light[: len(state.light)] = state.light
        params = self.params
        depth = min(selection.typical_range for selection in self.selections)
        stop = (params.min_step, self.level.camera.pixels_per_radian, depth, float(params.min_pixels))
        iterations, motion, is_determined = kernels.descend(
            *self._views, *self._image, T_world_camera, light, self._robust, stop, limit, is_rotation
        )
        pose = np.concatenate([T_world_camera, [[0.0, 0.0, 0.0, 1.0]]])
        return Descent(State(SE3(pose), light[: len(state.light)]), iterations, motion, is_determined)

    def linearise(self, state: State) -> tuple[Array, Array, int]:
        """Return H, g over (xi, gain 1, bias 1, ...) with H x = -g, and the number of visible pixels (eq. 6, 31-35)."""
        T_world_camera = np.ascontiguousarray(state.T_world_camera.matrix[:3])
        H, g, visible = kernels.linearise(*self._views, *self._image, T_world_camera, state.light, *self._robust)
        return H, g, int(visible)

    def compare(self, state: State) -> list[Comparison]:
        """Compare the image with every view at a state, each pixel once more."""
        T_camera_world = state.T_world_camera.inverse()
        facts, found = np.empty(kernels.NUM_FACTS), []
        for selection, T_world_reference, (gain, bias) in zip(
            self.selections, self.T_world_reference, state.light.tolist(), strict=True
        ):
            T = np.ascontiguousarray((T_camera_world @ T_world_reference).matrix[:3])
            pieces = np.empty((kernels.NUM_PIECES, kernels.NUM_SUMS))
            robust = (self.params.huber, self.params.min_sigma)
            count = kernels.examine(selection.blocks, T, *self._image, gain, bias, *robust, facts, pieces)
            median, mad, num_visible, num_inliers, *correlation = facts.tolist()
            sigma = max(kernels.SIGMA_OF_MAD * mad, self.params.min_sigma)
            counts = int(num_visible), int(num_inliers)
            found.append(Comparison(T, median, mad, sigma, *counts, np.array(correlation), pieces[:count]))
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
    def _robust(self) -> tuple[float, float, bool]:
        return self.params.huber, self.params.min_sigma, self.params.illumination
