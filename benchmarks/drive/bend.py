"""A street that bends all the way, as a car sees it by a stereo pair: spheres, and where the left camera truly was."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

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


@dataclass(frozen=True, eq=False)
class Street:
    """The spheres of a drive through a bend, range by the pair alone, and where they truly were, body axes."""

    spheres: list[Sphere]
    poses: list[SE3]

    @staticmethod
    def render(seed: int, side: int, number: int) -> Street:
        """Return the drive of so many images through the bend of a seed, to the left (1) or to the right (-1)."""
        radians = np.radians(side * TURN_DEG) / STEP_M
        path = Path((0.0, 0.0, 0.0), (Piece(np.radians(AROUND) / abs(radians), radians),))
        rng, poses = np.random.default_rng([seed, 2]), list[SE3]()
        for index in range(number):
            x, y, yaw, _ = path.at(BEGIN_M + index * STEP_M).tolist()
            shake = SE3.exp([0.0, 0.0, 0.0, *rng.normal(0.0, SHAKE_RAD, 2), 0.0])
            poses.append(SE3.from_planar(x, y, yaw) @ SE3.from_parts(np.eye(3), [0.0, 0.0, HEIGHT_M]) @ shake)
        return Street(list(_look(seed, path, poses)), poses)


def _look(seed: int, path: Path, poses: list[SE3]) -> Iterator[Sphere]:
    renderer = Renderer(build_road(seed, path, BOUNDS), RenderParams(), LightParams(), num_threads=1)
    rng, T_left_right = np.random.default_rng([seed, 3]), SE3.from_parts(np.eye(3), [BASELINE_M, 0.0, 0.0])
    for number, T_world_body in enumerate(poses, start=1):
        T_world_left, pair = T_world_body @ T_BODY_OPTICAL, []
        for T_world_camera in (T_world_left, T_world_left @ T_left_right):
            levels, _ = renderer.render(CAMERA, T_world_camera, is_gray=True)
            pair.append(np.clip(np.rint(levels + rng.normal(0.0, NOISE, levels.shape)), 0, 255).astype(np.uint8))
        left, right = pair
        yield sphere_from_stereo(left, right, CAMERA, BASELINE_M, T_BODY_OPTICAL, number * PERIOD_NS)
