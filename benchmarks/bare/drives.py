"""Drives through the simulator's worlds: ways, panoramas, truth, odometry and tilt."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cycab_sim.params import CarParams, LightParams, RenderParams, TrafficParams
from cycab_sim.rendering.renderer import Renderer
from cycab_sim.sensors.cameras import panorama
from cycab_sim.sensors.imaging import expose
from cycab_sim.world.paths import Path, Piece, turn
from cycab_sim.world.town import Plan, draw_plan
from cycab_sim.world.traffic.traffic import Traffic
from cycab_sim.world.worlds import World, build_world, geometry_cloud
from mcl_depth.belief.estimate import Observation
from mcl_depth.belief.motion_model import compose_planar, planar_pose, relative_motion, wrap_angle
from mcl_depth.geometry.cloud import cloud_from_points
from mcl_depth.params import FilterParams
from mcl_depth.site import Site
from sphere_nav.geometry import SE3, so3
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.status import State
from sphere_nav.params import build

RADIUS = 5.0  # of the bends of a way, m
SIDE = 100.0  # of the part of the town that is considered, m
MAX_OFFSET = 1.3  # to the right or left of the middle of the street, m; cars are parked further out
MARGIN = 2.0  # from the edge of that part, m
HEIGHT = 1.8  # of the camera above the ground, m
PANORAMA = panorama(360, 96, "panorama")  # 96 degrees high, of which 85 are compared
T_BASE_CAMERA = SE3.from_parts(np.eye(3), [0.4, 0.0, HEIGHT])
WAY_SHARE, TURN_DEG = 0.05, 1.0  # odometry: share of a step; for a way of one metre, growing with its square root
TILT_DEG = 0.2  # of the IMU
CLEAR = 1.2  # room around the camera that traffic leaves free, m
READ_NOISE, SHOT_NOISE = 1.2, 0.012  # grey levels, as of the vehicle's camera
SHADOWLESS = LightParams(exposure=0.5)
Step = tuple[Observation, Array]  # and x, y, yaw (3,) of the level camera in the map
LIGHTS = (LightParams(), LightParams(sun="95,20", exposure=0.7), LightParams(sun="320,60", exposure=1.2), SHADOWLESS)
SPACING = 0.2  # of the points of a cloud, m
NEAR_M, NEAR_DEG = 1.0, 10.0  # a pose this close to the truth is the right place


@dataclass(frozen=True, eq=False)
class Drive:
    """Images (K, H, W) u1, true poses of the base T_map_base (K,), odometry (K, 3) m, rad, and tilts (K, 3, 3)."""

    images: NDArray[np.uint8]
    T_map_base: SE3
    odometry: Array
    tilts: Array  # R_level_base as the IMU has it

    def steps(self) -> Iterator[Step]:
        """Yield what the filter takes for each image, and the true place."""
        for index, image in enumerate(self.images):
            odometry = planar_pose(SE3.from_planar(*map(float, self.odometry[index])) @ T_BASE_CAMERA)
            observation = Observation(image, PANORAMA, (index + 1) * 10**9, self.tilts[index], odometry)
            yield observation, self.truth(index)

    @property
    def mirrored(self) -> Drive:
        """The drive as a mirror shows it, through a world whose left is right: a control that fits no place."""
        mirror, turned = np.diag([1.0, -1.0, 1.0]), np.array([1.0, -1.0, -1.0])
        images = np.ascontiguousarray(self.images[:, :, ::-1])
        return replace(self, images=images, odometry=self.odometry * turned, tilts=mirror @ self.tilts @ mirror)

    def truth(self, index: int) -> Array:
        """Return x, y, yaw (3,) of the level camera in the map."""
        T_map_base = self.T_map_base[index]
        place = (T_map_base @ T_BASE_CAMERA).translation
        return np.array([place[0], place[1], float(T_map_base.yaw)])


def record(town: int, line: Array, seed: int, light: LightParams = LIGHTS[0]) -> Drive:
    """Return a drive through a town along planar poses (K, 3) of the base; `seed` decides every noise."""
    rng, images, poses = np.random.default_rng([town, seed, 71]), [], []
    renderer, traffic = _renderer(town, light)
    for index, pose in enumerate(line):
        poses.append(on_ground(_built(town).ground, pose))
        T_map_camera = poses[-1] @ T_BASE_CAMERA
        stamp = (seed * 1000 + index) * 10**9  # every drive at another time, an image a second
        renderer.move(traffic.poses(stamp, T_map_camera.translation[None, :2], CLEAR))
        levels, _ = renderer.render(PANORAMA, T_map_camera, is_gray=True)
        images.append(expose(levels, READ_NOISE, SHOT_NOISE, (town, seed, index)))
    T_map_base = SE3.from_matrix(np.stack([pose.matrix for pose in poses]))
    return Drive(np.stack(images), T_map_base, noisy_odometry(line, rng), _tilts(T_map_base, rng))


@lru_cache(maxsize=2)
def _built(seed: int) -> World:
    return build_world("town", seed, "block")


@lru_cache(maxsize=2)
def _renderer(seed: int, light: LightParams) -> tuple[Renderer, Traffic]:
    """Return what draws a town, and who moves in its streets: cars, a tram, bicycles, pedestrians."""
    built = _built(seed)
    traffic = Traffic(built, TrafficParams(density="usual", may_cross=True), seed)
    return Renderer(built.mesh, shadows_in(light), light, traffic), traffic


def shadows_in(light: LightParams) -> RenderParams:
    """Return how a light is drawn: one is without shadows."""
    return RenderParams(shadow_texel=0.0) if light == SHADOWLESS else RenderParams()


def on_ground(ground: Any, pose: Array) -> SE3:
    """Return where a car stands at a planar pose (3,)."""
    vehicle = CarParams()
    T_world_base: SE3 = ground.follow(SE3.from_planar(*map(float, pose)), vehicle.wheelbase, vehicle.width)
    return T_world_base


def noisy_odometry(line: Array, rng: np.random.Generator) -> Array:
    """Return the way as noisy wheels have it, from the origin."""
    poses = [np.zeros(3)]
    for before, after in pairwise(line):
        motion = relative_motion(before[:3], after[:3])
        motion[:2] *= 1.0 + WAY_SHARE * rng.standard_normal()
        motion[2] += np.radians(TURN_DEG) * np.sqrt(np.hypot(motion[0], motion[1])) * rng.standard_normal()
        poses.append(compose_planar(poses[-1][None], motion)[0])
    return np.array(poses)


def _tilts(T_map_base: SE3, rng: np.random.Generator) -> Array:
    """Return R_level_base (K, 3, 3) with the noise of an IMU."""
    tilts = []
    for rotation, yaw in zip(T_map_base.rotation, np.atleast_1d(T_map_base.yaw), strict=True):
        noise = so3.exp(np.radians(TILT_DEG) * rng.standard_normal(3) * [1.0, 1.0, 0.0])
        tilts.append(so3.exp(np.array([0.0, 0.0, -float(yaw)])) @ rotation @ noise)
    return np.stack(tilts)


def limits(plan: Plan) -> tuple[float, float, float, float]:
    """Return x0, y0, x1, y1 of a square of 100 x 100 m around the middle of the town."""
    x, y, half = plan.east / 2, plan.north / 2, SIDE / 2
    return x - half, y - half, x + half, y + half


def kidnapped_line(plan: Plan, count: int, step: float, rng: np.random.Generator) -> Array:
    """Return poses (count, 3) from anywhere in the streets onwards; at a crossing by lot left, right or straight on."""
    x0, y0, x1, y1 = limits(plan)
    while True:
        poses = _drawn(plan, rng).at(np.arange(count) * step)[:, :3]
        inside = (poses[:, 0] > x0 + MARGIN) & (poses[:, 0] < x1 - MARGIN)
        if np.all(inside & (poses[:, 1] > y0 + MARGIN) & (poses[:, 1] < y1 - MARGIN)):
            return poses


def kidnapped(town: int, count: int, num_images: int) -> list[Drive]:
    """Return drives from anywhere in a town, each with one of the lights; images are a metre apart."""
    plan, order = draw_plan(town), sorted(range(count), key=lambda n: n % len(LIGHTS))  # shadows are cast once
    lines = [kidnapped_line(plan, num_images, 1.0, np.random.default_rng([town, n, 83])) for n in range(count)]
    made = {n: record(town, lines[n], n, LIGHTS[n % len(LIGHTS)]) for n in order}
    return [made[number] for number in range(count)]


def _drawn(plan: Plan, rng: np.random.Generator) -> Path:
    """Return a way along a street, around the next corner or past it; outside of the town where it was badly drawn."""
    is_along_x, is_upwards = rng.random() < 0.5, rng.random() < 0.5
    across = (0.0, plan.north) if is_along_x else (0.0, plan.east)  # the streets of this direction
    ahead = (0.0, plan.east) if is_along_x else (0.0, plan.north)  # where streets cross them
    yaw = (0.0 if is_upwards else np.pi) if is_along_x else (np.pi / 2 if is_upwards else -np.pi / 2)
    street, begin, right = across[int(rng.integers(2))], rng.uniform(-50.0, 90.0), rng.uniform(-MAX_OFFSET, MAX_OFFSET)
    middle = np.array([begin, street]) if is_along_x else np.array([street, begin])
    start = middle + right * np.array([np.sin(yaw), -np.cos(yaw)])
    sign = 1.0 if is_upwards else -1.0
    ways = [sign * (crossing - begin) for crossing in ahead if sign * (crossing - begin) > RADIUS + MAX_OFFSET]
    choice = int(rng.integers(3))
    pieces: tuple[Piece, ...] = (Piece(1.0),)
    if ways and choice:
        side = 1.0 if choice == 1 else -1.0  # left, right
        pieces = (Piece(min(ways) + side * right - RADIUS), turn(RADIUS, side * 90.0), Piece(1.0))
    return Path((float(start[0]), float(start[1]), float(yaw)), pieces)


@dataclass(frozen=True)
class Trial:
    """What a filter said of K images: state and reason, errors of the likeliest place, CPU, all (K,)."""

    states: tuple[State, ...]
    reasons: tuple[str, ...]
    meters: Array
    degrees: Array
    p_chance: Array
    cpu_ms: Array

    @property
    def is_right(self) -> NDArray[np.bool_]:
        """Whether the likeliest place was the right one, (K,)."""
        return (self.meters <= NEAR_M) & (self.degrees <= NEAR_DEG)

    @property
    def is_tracking(self) -> NDArray[np.bool_]:
        """Whether the status was TRACKING, (K,)."""
        return np.array([state is State.TRACKING for state in self.states])

    @property
    def is_trusted(self) -> NDArray[np.bool_]:
        """Whether a pose left the filter: TRACKING or DEGRADED, (K,)."""
        return np.array([state in (State.TRACKING, State.DEGRADED) for state in self.states])

    @property
    def has_converged(self) -> bool:
        """Whether the last image found the filter in TRACKING at the right place."""
        return bool(self.is_tracking[-1] and self.is_right[-1])

    @property
    def num_false(self) -> int:
        """Images with the status TRACKING at a wrong place."""
        return int(np.sum(self.is_tracking & ~self.is_right))


def build_town(seed: int, share: float = 1.0) -> tuple[Site, Plan]:
    """Return the 100 x 100 m around the middle of a town, or a share of it from the left, and the town's plan."""
    plan, cloud = draw_plan(seed), geometry_cloud(seed, SPACING, "town")
    x0, y0, x1, y1 = limits(plan)
    box = {"area.limits": f"{x0:.2f},{y0:.2f},{x0 + share * (x1 - x0):.2f},{y1:.2f}"}
    return Site(cloud_from_points(cloud.astype(np.float32), "town"), PANORAMA, HEIGHT, build(FilterParams, box)), plan


def run_filter(site: Site, steps: Iterable[Step], seed: int, start: tuple[Array, Array] | None = None) -> Trial:
    """Return what a filter says of the images of a drive.

    It knows nothing, or a `start`: pose (3,) and standard deviations (3,).
    """
    site.params = replace(site.params, seed=seed)
    filter_ = site.filter()
    if start is not None:
        (x, y, yaw), (sigma_x, sigma_y, sigma_yaw) = start
        covariance = np.diag(np.square([sigma_x, sigma_y, 0.1, 0.1, 0.1, sigma_yaw]))
        filter_.start(SE3.from_planar(float(x), float(y), float(yaw)), covariance)
    found: list[tuple[Any, ...]] = []
    for observation, truth in steps:
        begun = time.process_time()
        estimate = filter_.update(observation)
        cpu_ms = 1e3 * (time.process_time() - begun)
        error, status = place_of(estimate) - truth, estimate.status
        degrees = abs(float(np.degrees(wrap_angle(error[2]))))
        meters = float(np.hypot(*error[:2]))
        found.append((status.state, str(status.reason), meters, degrees, status.p_chance, cpu_ms))
    states, reasons, *numbers = zip(*found, strict=True)
    return Trial(states, reasons, *map(np.array, numbers))


def place_of(estimate: Any) -> Array:
    """Return x, y, yaw (3,) of what leaves the filter, else of its likeliest place, else NaN."""
    if estimate.T_map_level is not None:
        T_map_level: SE3 = estimate.T_map_level
        return np.array([*T_map_level.translation[:2], float(T_map_level.yaw)])
    if estimate.belief is not None:
        return np.asarray(estimate.belief.best.pose)
    return np.full(3, np.nan)
