"""A street that bends all the way, as a car sees it by a stereo pair: images, and where the left camera truly was."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cycab_sim.params import LightParams, RenderParams
from cycab_sim.rendering.renderer import Renderer
from cycab_sim.world import finishes, furniture
from cycab_sim.world.building import add_house
from cycab_sim.world.mesh import Mesh, MeshBuilder, placed
from cycab_sim.world.paths import Path, Piece
from cycab_sim.world.street import HALF_ROAD, KERB_HEIGHT, PAVEMENT, add_ground
from cycab_sim.world.town import add_on_pavement, add_skyline
from sphere_mapping.acquisition.stereo.stereo import sphere_from_stereo
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere

STEP_M, TURN_DEG, PERIOD_NS = 1.0, 2.6, 100_000_000  # of an image: 10 m/s, 26 degrees a second
CAMERA = Pinhole(1226, 370, 707.1, 707.1, 601.9, 183.1)  # as a car of KITTI carries
BASELINE_M, HEIGHT_M = 0.54, 1.65
SHAKE_RAD, NOISE = np.radians(0.25), 2.0  # standard deviations: of roll and pitch, from image to image; grey levels
DEEP = 8.0  # of a house, m
AROUND = 145.0  # degrees of the bend that are built


@dataclass(frozen=True)
class Bend:
    """A street of a seed that turns to the left, or to the right, by so much a metre."""

    seed: int
    turn_deg: float = TURN_DEG

    @property
    def path(self) -> Path:
        """The middle of the road, which begins within the bend."""
        radians = np.radians(self.turn_deg) / STEP_M
        return Path((0.0, -0.8, 0.0), (Piece(np.radians(AROUND) / abs(radians), radians),))

    def poses(self, number: int, step_m: float = STEP_M) -> list[SE3]:
        """Return T_world_body of the left camera, body axes, image by image."""
        rng = np.random.default_rng([self.seed, 2])
        found = []
        for index in range(number):
            x, y, yaw, _ = self.path.at(index * step_m).tolist()
            shake = SE3.exp([0.0, 0.0, 0.0, *rng.normal(0.0, SHAKE_RAD, 2), 0.0])
            found.append(SE3.from_planar(x, y, yaw) @ SE3.from_parts(np.eye(3), [0.0, 0.0, HEIGHT_M]) @ shake)
        return found

    def pairs(self, poses: list[SE3]) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.uint8]]]:
        """Yield the grey images (H, W) of both cameras at each pose."""
        renderer = Renderer(_build(self), RenderParams(), LightParams(), num_threads=1)
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


@lru_cache(maxsize=1)
def _build(bend: Bend) -> Mesh:
    """Return the street: houses, trees, cars and what stands on pavements along both kerbs."""
    rng = np.random.default_rng([bend.seed, 1])
    mesh = MeshBuilder(rng)
    radius = STEP_M / np.radians(abs(bend.turn_deg))
    side = np.sign(bend.turn_deg)
    bounds = (-2.0 * radius, -2.5 * radius, 2.0 * radius, 2.5 * radius)
    add_ground(mesh, bounds)

    def place(angle: float, r: float, yaw: float = 0.0, height: float = 0.0) -> NDArray[np.float64]:
        """Return the place at an angle along the bend, r m from its centre, x along the road, z up."""
        x, y = r * np.sin(angle), side * (radius - r * np.cos(angle)) - 0.8
        return placed(float(x), float(y), float(side * angle + yaw), height)

    wall = HALF_ROAD + PAVEMENT
    for sign in (-1.0, 1.0):  # the kerb within, the kerb outside
        low, high = radius + sign * HALF_ROAD, radius + sign * wall
        is_left = side * sign < 0  # of the road
        for angle in np.arange(-0.1, np.radians(AROUND) + 0.6, 0.1):
            corners = [(angle, low), (angle + 0.1, low), (angle + 0.1, high), (angle, high)]
            quad = np.array([place(a, r, height=KERB_HEIGHT)[:3, 3] for a, r in corners])
            mesh.panels([quad if is_left else quad[::-1]], finishes.PAVING)
        kerb_yaw = 0.0 if is_left else np.pi  # y away from the road
        angle = -0.05
        while angle < np.radians(AROUND) + 0.5:
            width = rng.uniform(5.5, 8.5)
            turn = width / high
            at = place(angle if is_left else angle + turn, high, 0.5 * (turn if is_left else -turn) * side + kerb_yaw)
            back = rng.uniform(0.3, 1.2)
            add_house(mesh, at @ placed(0.0, back, 0.0, KERB_HEIGHT), width, DEEP, int(rng.integers(2, 5)), rng)
            angle += turn + (rng.uniform(1.5, 4.0) / high if rng.random() < 0.25 else 0.0)
        for angle in np.arange(rng.uniform(0.0, 0.1), np.radians(AROUND) + 0.4, 5.0 / low):
            add_on_pavement(mesh, place(angle, low, kerb_yaw, KERB_HEIGHT), rng)
            if rng.random() < 0.4:
                furniture.add_car(mesh, place(angle, low, kerb_yaw) @ placed(0.0, -1.05, 0.0), rng)
    add_skyline(mesh, bounds, rng)
    return mesh.build()
