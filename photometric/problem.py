"""The least-squares problem of one pyramid level: chosen pixels of all views, one pose, a gain and bias each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dposv

from photometric.normal_equations import NormalEquations, ViewSolver
from photometric.params import RegistrationParams
from photometric.pyramid import Level
from photometric.reference import View
from photometric.selection import choose, level_like
from sphere_geometry import SE3

Array = NDArray[np.float64]
GAIN_LIMITS = (0.1, 10.0)
LIGHT_PRIOR = 1e-9 * np.eye(2)  # keeps gain and bias defined on an even image


@dataclass(frozen=True)
class Step:
    """An increment: xi (6,) of the pose, and for each view what is added to its gain and bias."""

    xi: Array
    gains: Array
    biases: Array


@dataclass(frozen=True)
class State:
    """What is estimated."""

    T_world_camera: SE3
    gains: tuple[float, ...]
    biases: tuple[float, ...]

    @staticmethod
    def start(T_world_camera: SE3, num_views: int) -> State:
        """Return the first guess: the given pose, the same light."""
        return State(T_world_camera, (1.0,) * num_views, (0.0,) * num_views)

    def moved(self, step: Step) -> State:
        """Return the state after an increment (M15 eq. 7)."""
        low, high = GAIN_LIMITS
        gains = tuple(min(max(gain + d, low), high) for gain, d in zip(self.gains, step.gains.tolist(), strict=True))
        biases = tuple(bias + d for bias, d in zip(self.biases, step.biases.tolist(), strict=True))
        return State(self.T_world_camera @ SE3.exp(step.xi), gains, biases)


@dataclass(frozen=True)
class Problem:
    """The views of one level with their chosen pixels."""

    solvers: tuple[ViewSolver, ...]
    T_world_reference: tuple[SE3, ...]
    level: Level
    params: RegistrationParams

    @staticmethod
    def choose_pixels(level: Level, views: Sequence[View], T_world_camera: SE3, params: RegistrationParams) -> Problem:
        """Pick the most salient pixels that the camera sees from the guessed pose, s(.) of M15 eq. 16."""
        share = params.max_pixels // len(views)
        solvers = []
        for view in views:
            pixels = level_like(view.reference, level)
            T_camera_reference = T_world_camera.inverse() @ view.T_world_reference
            solvers.append(ViewSolver(choose(pixels, T_camera_reference, level, share), level))
        return Problem(tuple(solvers), tuple(view.T_world_reference for view in views), level, params)

    def compare(self, state: State) -> list[NormalEquations]:
        """Compare the image with every view at a state."""
        rows = zip(self.solvers, self.T_camera_reference(state), state.gains, state.biases, strict=True)
        return [solver.compare(T, gain, bias, self.params) for solver, T, gain, bias in rows]

    def T_camera_reference(self, state: State) -> list[SE3]:
        """Return where each reference is in the camera frame."""
        T_camera_world = state.T_world_camera.inverse()
        return [T_camera_world @ T_world_reference for T_world_reference in self.T_world_reference]

    def step(self, state: State, rotation_only: bool = False) -> Step | None:
        """Return the Gauss-Newton increment (M15 eq. 6, 20), or None where the image does not determine it."""
        found = self.compare(state)
        if sum(view.num_visible for view in found) < self.params.min_pixels:
            return None
        H, g = self.joint(found)
        x = np.zeros_like(g)
        first = 3 if rotation_only else 0
        solution = _solve(H[first:, first:], g[first:])
        if solution is None:
            return None
        x[first:] = solution
        number = len(self.solvers)
        if not self.params.illumination:
            return Step(x, np.zeros(number), np.zeros(number))
        return Step(x[:6], x[6::2], x[7::2])

    def joint(self, found: list[NormalEquations]) -> tuple[Array, Array]:
        """Stack the views into one system over (xi, gain 1, bias 1, gain 2, bias 2, ...) (M15 eq. 19, 31).

        Unlike in the paper each view counts by the inverse variance of its residuals, so that a distant reference
        with much occlusion steadies the result without pulling it.
        """
        size = 6 + 2 * len(found) if self.params.illumination else 6
        H, g = np.zeros((size, size)), np.zeros(size)
        for index, view in enumerate(found):
            H[:6, :6] += view.H[:6, :6]
            g[:6] += view.g[:6]
            if self.params.illumination:
                light = slice(6 + 2 * index, 8 + 2 * index)
                H[light, light] = view.H[6:, 6:] + LIGHT_PRIOR
                H[:6, light] = view.H[:6, 6:]
                H[light, :6] = view.H[6:, :6]
                g[light] = view.g[6:]
        return H, g

    def image_motion(self, step: Step) -> float:
        """Return how far an increment moves the image, in pixels of this level: rotation plus parallax."""
        depth = min(solver.pixels.typical_range for solver in self.solvers)
        x, y, z, a, b, c = step.xi.tolist()
        angle = math.hypot(a, b, c) + math.hypot(x, y, z) / depth
        return angle * self.level.camera.pixels_per_radian


def _solve(H: Array, g: Array) -> Array | None:
    """Return -H^-1 g by Cholesky of the scaled matrix, or None where H is not positive definite."""
    diagonal = np.diagonal(H)
    if not np.all(np.isfinite(H)) or diagonal.min() <= 0:
        return None
    scale = 1.0 / np.sqrt(diagonal)
    _, x, failed = dposv(H * np.outer(scale, scale), scale * g)
    solution: Array = -scale * x
    return None if failed or not np.all(np.isfinite(solution)) else solution
