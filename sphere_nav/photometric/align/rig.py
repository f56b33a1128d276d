"""The images of one to n cameras that are fixed to one another, and their least-squares problem (M15 eq. 8, 19).

The normal equations of each camera are those of `problem.py`, transformed to the increment of the body,
T_world_body @ exp(xi): T_world_camera @ exp(Ad(T_camera_body) xi) is the same motion. Each view has its own light.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from sphere_nav.estimation.kernels import newton_step
from sphere_nav.geometry import SE3, Camera, FrameMotion
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.photometric.align.alignment import Alignment
from sphere_nav.photometric.align.descent import kernels
from sphere_nav.photometric.align.expectation import NO_EXPECTATION, Expectation
from sphere_nav.photometric.align.judgement import classify, normal_matrix
from sphere_nav.photometric.align.problem import AlignmentState, Descent, Problem, ViewComparison
from sphere_nav.photometric.align.projection import kernel_motion
from sphere_nav.photometric.constants import OVERLAP_CELL
from sphere_nav.photometric.params import RegistrationParams
from sphere_nav.photometric.pixels.kernels import cover
from sphere_nav.photometric.pixels.pyramid import Pyramid
from sphere_nav.photometric.pixels.reference import View


@dataclass(frozen=True)
class RigImage:
    """The image of one camera of a rig, with the references that it is compared with.

    T_body_camera None: the camera is the body. `name` tells the cameras of a rig apart.
    """

    pyramid: Pyramid
    T_body_camera: SE3 | None = None
    views: tuple[View, ...] = ()
    name: str = ""

    def pose(self, T_world_body: SE3) -> SE3:
        """Return T_world_camera."""
        return T_world_body if self.T_body_camera is None else T_world_body @ self.T_body_camera

    def body(self, T_world_camera: SE3) -> SE3:
        """Return T_world_body."""
        return T_world_camera if self.T_body_camera is None else T_world_camera @ self.T_body_camera.inverse()

    def motion(self, motion: FrameMotion | None) -> FrameMotion | None:
        """Return the motion of the camera within the frame by that of the body."""
        return motion and replace(motion, T_world_before=self.pose(motion.T_world_before))


@cache
def share_pixels(params: RegistrationParams, number: int) -> RegistrationParams:
    """Return the parameters of one of so many cameras."""
    return replace(params, max_pixels=max(params.max_pixels // number, 1))


@dataclass(frozen=True)
class RigProblem:
    """The least-squares problem of one level: those of the cameras, about one pose, and what is known of it."""

    images: tuple[RigImage, ...]
    problems: tuple[Problem, ...]
    expected: Expectation = NO_EXPECTATION

    @staticmethod
    def choose_pixels(
        images: Sequence[RigImage],
        index: int,
        T_world_body: SE3,
        params: RegistrationParams,
        motion: FrameMotion | None = None,
        expected: Expectation = NO_EXPECTATION,
    ) -> RigProblem:
        """Pick the pixels of each camera at a level, or at its coarsest where it has fewer."""
        problems = []
        for image in images:
            level = image.pyramid.levels[min(index, len(image.pyramid.levels) - 1)]
            args = image.views, image.pose(T_world_body), params, image.motion(motion)
            problems.append(Problem.choose_pixels(level, *args))
        return RigProblem(tuple(images), tuple(problems), expected)

    @property
    def is_camera(self) -> bool:
        """Whether the body is a camera, and no other one is with it: nothing is to be transformed."""
        return len(self.images) == 1 and self.images[0].T_body_camera is None

    def states(self, state: AlignmentState) -> list[AlignmentState]:
        """Return the state of each camera: its pose, the light of its views."""
        ends = np.cumsum([len(image.views) for image in self.images])
        lights = np.split(state.light, ends[:-1])
        return [
            AlignmentState(image.pose(state.T_world_camera), np.ascontiguousarray(light))
            for image, light in zip(self.images, lights, strict=True)
        ]

    def linearize(self, state: AlignmentState) -> tuple[Array, Array, int]:
        """Return H, g over (xi of the body, gain 1, bias 1, ...) of all views, and the number of visible pixels."""
        states = zip(self.problems, self.states(state), strict=True)
        parts = [problem.linearize(one) for problem, one in states]
        systems = [(H, g) for H, g, _ in parts]
        return *self.join(systems), sum(visible for _, _, visible in parts)

    def join(self, systems: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
        """Return the sum of the cameras' H, g about the body (eq. 8); each camera's light keeps rows of its own."""
        if self.is_camera:
            return systems[0]
        size = 6 + sum(len(g) - 6 for _, g in systems)
        H, g, first = np.zeros((size, size)), np.zeros(size), 6
        for image, (h, q) in zip(self.images, systems, strict=True):
            number = len(q) - 6
            A = np.zeros((6 + number, size))
            A[:6, :6] = np.eye(6) if image.T_body_camera is None else image.T_body_camera.inverse().adjoint()
            A[6:, first : first + number] = np.eye(number)
            H += A.T @ h @ A
            g += A.T @ q
            first += number
        return H, g

    def descend(self, state: AlignmentState, limit: int) -> Descent:
        """Iterate until the increment moves no image by more than `min_step` (eq. 6-7), `limit` times at most.

        That of a camera alone is compiled as a whole.
        """
        if self.is_camera:
            return self.problems[0].descend(state, limit, self.expected)
        params, motion = self.problems[0].params, 0.0
        expected = self.expected.weighted(params.correlated_pixels)
        for iteration in range(limit):
            H, g, visible = self.linearize(state)
            if visible < params.min_pixels:
                return Descent(state, iteration, motion, is_determined=False)
            kernels.add_expectation(np.ascontiguousarray(state.T_world_camera.matrix[:3]), expected, H, g)
            x, is_found = newton_step(H, g, int(kernels.START))
            if not is_found:
                return Descent(state, iteration, motion, is_determined=False)
            light = state.light + x[6:].reshape(-1, 2)
            light[:, 0] = np.clip(light[:, 0], kernels.MIN_GAIN, kernels.MAX_GAIN)
            state = AlignmentState(state.T_world_camera @ SE3.exp(x[:6]), light)
            motion = max(
                self._shift(problem, image, x[:6]) for problem, image in zip(self.problems, self.images, strict=True)
            )
            if motion < params.min_step:
                return Descent(state, iteration + 1, motion, is_determined=True)
        return Descent(state, limit, motion, is_determined=True)

    @staticmethod
    def _shift(problem: Problem, image: RigImage, xi: Array) -> float:
        """Return by how many pixels an increment of the body moves the image of a camera."""
        if image.T_body_camera is not None:
            xi = image.T_body_camera.inverse().adjoint() @ xi
        depth = min(selection.typical_range for selection in problem.selections)
        turn, step = np.linalg.norm(xi[3:]), np.linalg.norm(xi[:3])
        return float(turn + step / depth) * problem.level.camera.pixels_per_radian

    def classify(self, descent: Descent, iterations: int, params: RegistrationParams) -> Alignment:
        """Say what the last descent has found, after so many iterations; compare once more where it did not end."""
        states = self.states(descent.state)
        parts = zip(self.problems, states, strict=True)
        found = descent.found or [view for problem, state in parts for view in problem.compare(state)]
        overlaps = [
            image_overlap(image.pyramid, image.views, state.T_world_camera)
            for image, state in zip(self.images, states, strict=True)
        ]
        H = self.normal_matrix(found)
        known = self.expected.pull_at(descent.state.T_world_camera)[0]
        return classify(found, H, descent, iterations, float(np.mean(overlaps)), params, known)

    def normal_matrix(self, found: Sequence[ViewComparison]) -> Array:
        """Return H over (xi of the body, gain 1, bias 1, ...) of the compared views of all cameras, in their order."""
        views, systems = iter(found), []
        for image in self.images:
            H = normal_matrix(list(islice(views, len(image.views))))
            systems.append((H, np.zeros(len(H))))
        return self.join(systems)[0]


def image_overlap(pyramid: Pyramid, views: Sequence[View], T_world_camera: SE3) -> float:
    """Return the share (0..1) of the image, in cells of the coarsest level, where some reference has range."""
    level = pyramid.levels[-1]
    camera = level.camera
    cells = _cells_with_rays(camera)
    covered = np.zeros_like(cells)
    T_camera_world = T_world_camera.inverse()
    image = (level.kernel_camera, camera.width, camera.height, OVERLAP_CELL, covered)
    for view in views:
        pixels = view.reference.level_like(camera)
        T_camera_reference = T_camera_world @ view.T_world_reference
        seen = pixels.squares.near(T_camera_reference, camera)
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
