"""A street that bends all the way, as a car sees it by a stereo pair: images, and where the left camera truly was."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.drive.street import build_road
from cycab_sim.params import LightParams, RenderParams
from cycab_sim.rendering.renderer import Renderer
from cycab_sim.world.paths import Path, Piece
from sphere_mapping.acquisition.stereo.stereo import sphere_from_stereo
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere

STEP_M, TURN_DEG, PERIOD_NS = 1.0, 2.6, 100_000_000  # of an image: 10 m/s, 26 degrees a second
CAMERA = Pinhole(1226, 370, 707.1, 707.1, 601.9, 183.1)  # as a car of KITTI carries
BASELINE_M, HEIGHT_M = 0.54, 1.65
SHAKE_RAD, NOISE = np.radians(0.25), 2.0  # standard deviations: of roll and pitch, from image to image; grey levels
BEGIN_M, BOUNDS = 10.0, (-110.0, -110.0, 110.0, 110.0)  # within the bend; of the ground, m
AROUND = 145.0  # degrees of the bend that are built


@dataclass(frozen=True)
class Bend:
    """A street of a seed that turns to the left, or to the right, by so much a metre."""

    seed: int
    turn_deg: float = TURN_DEG

    @property
    def path(self) -> Path:
        """The middle of the road."""
        radians = np.radians(self.turn_deg) / STEP_M
        return Path((0.0, 0.0, 0.0), (Piece(np.radians(AROUND) / abs(radians), radians),))

    def poses(self, number: int, step_m: float = STEP_M) -> list[SE3]:
        """Return T_world_body of the left camera, body axes, image by image."""
        rng = np.random.default_rng([self.seed, 2])
        found = []
        for index in range(number):
            x, y, yaw, _ = self.path.at(BEGIN_M + index * step_m).tolist()
            shake = SE3.exp([0.0, 0.0, 0.0, *rng.normal(0.0, SHAKE_RAD, 2), 0.0])
            found.append(SE3.from_planar(x, y, yaw) @ SE3.from_parts(np.eye(3), [0.0, 0.0, HEIGHT_M]) @ shake)
        return found

    def pairs(self, poses: list[SE3]) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.uint8]]]:
        """Yield the grey images (H, W) of both cameras at each pose."""
        renderer = Renderer(build_road(self.seed, self.path, BOUNDS), RenderParams(), LightParams(), num_threads=1)
        rng = np.random.default_rng([self.seed, 3])
        T_left_right = SE3.from_parts(np.eye(3), [BASELINE_M, 0.0, 0.0])
        for T_world_body in poses:
            T_world_left = T_world_body @ T_BODY_OPTICAL
            levels = [renderer.render(CAMERA, T, is_gray=True)[0] for T in (T_world_left, T_world_left @ T_left_right)]
            left, right = (
                np.clip(np.rint(one + rng.normal(0.0, NOISE, one.shape)), 0, 255).astype(np.uint8) for one in levels
            )
            yield left, right

    def spheres(self, poses: list[SE3]) -> Iterator[Sphere]:
        """Yield the sphere of each pose, range by the pair alone."""
        for number, (left, right) in enumerate(self.pairs(poses)):
            yield sphere_from_stereo(left, right, CAMERA, BASELINE_M, T_BODY_OPTICAL, (number + 1) * PERIOD_NS)
