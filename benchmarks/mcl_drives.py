"""Drives through the simulator's worlds: images of any camera, truth, odometry and tilt; kept on disk between runs."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cycab_sim
from cycab_sim.params import CarParams, LightParams, RenderParams, TrafficParams
from cycab_sim.rendering.renderer import Renderer
from cycab_sim.sensors.cameras import OPTICAL, panorama
from cycab_sim.sensors.imaging import expose
from cycab_sim.simulator import T_BASE_TORCH
from cycab_sim.world.traffic.traffic import Traffic
from cycab_sim.world.worlds import World, build_world
from mcl_depth.belief.estimate import Observation
from mcl_depth.belief.motion_model import compose_planar, relative_motion
from sphere_nav.geometry import SE3, Camera, Fisheye, Pinhole, so3
from sphere_nav.geometry.arrays import Array

HEIGHT = 1.8  # of the camera above the ground, m
BODY_AXES = SE3.from_parts(np.eye(3), [0.4, 0.0, HEIGHT])  # a panorama's axes are those of the vehicle
OPTICAL_AXES = SE3.from_parts(OPTICAL, [0.4, 0.0, HEIGHT])
UP_AXES = SE3.from_parts([[0, 1, 0], [-1, 0, 0], [0, 0, 1]], [0.4, 0.0, HEIGHT])  # looks at the zenith
WAY_SHARE, TURN_DEG = 0.05, 1.0  # odometry: share of a step; for a way of one metre, growing with its square root
TILT_DEG = 0.2  # of the IMU
CLEAR = 1.2  # room around the camera that traffic leaves free, m
READ_NOISE, SHOT_NOISE = 1.2, 0.012  # grey levels, as of the vehicle's camera
SHADOWLESS = LightParams(exposure=0.5)
LIGHTS = (
    LightParams(),
    LightParams(sun="95,20", exposure=0.7),
    LightParams(sun="320,60", exposure=1.2),
    SHADOWLESS,
)
NIGHT = LightParams(sun="300,22.0h", has_street_lamps=True, torch=3000.0, exposure=900.0)  # head lamp, street lamps
NIGHT_NOISE = 3.0  # times that by day
LEVELS, LEVEL, MAX_GAIN = (30.0, 170.0), 90.0, 50.0  # mean grey levels that an exposure is left at by night, and set to


@dataclass(frozen=True)
class Lens:
    """A camera and where it sits on the vehicle."""

    camera: Camera
    T_base_camera: SE3


PANORAMA = Lens(panorama(360, 96, "panorama"), BODY_AXES)  # 96 degrees high, of which 85 are compared
_FOCAL = 160.0 / np.tan(np.radians(50.0))
PINHOLE_100 = Lens(Pinhole(320, 240, _FOCAL, _FOCAL, 159.5, 119.5), OPTICAL_AXES)
_PER_RAD = 150.0 / np.radians(95.0)
FISHEYE_190 = Lens(Fisheye(300, 300, _PER_RAD, _PER_RAD, 149.5, 149.5), OPTICAL_AXES)
FISHEYE_UP = Lens(Fisheye(300, 300, _PER_RAD, _PER_RAD, 149.5, 149.5), UP_AXES)
LENSES: dict[str, Lens] = {  # degrees of view; forward, or to the sky
    "panorama": PANORAMA,
    "pinhole_100": PINHOLE_100,
    "fisheye_190": FISHEYE_190,
    "fisheye_190_up": FISHEYE_UP,
}


@dataclass(frozen=True, eq=False)
class Drive:
    """Images (K, H, W) u1, true poses of the base T_map_base (K,), odometry (K, 3) m, rad, and tilts (K, 3, 3)."""

    images: NDArray[np.uint8]
    lens: Lens
    T_map_base: SE3
    odometry: Array
    tilts: Array  # R_level_base as the IMU has it

    def __len__(self) -> int:
        return len(self.images)

    def observation(self, index: int, *, has_imu: bool = True) -> Observation:
        """Return what the filter takes for one image."""
        T_base_camera = self.lens.T_base_camera
        tilt = self.tilts[index] if has_imu else np.eye(3)
        T_base_level = SE3.from_parts(np.eye(3), T_base_camera.translation)
        T_odom_level = SE3.from_planar(*(float(x) for x in self.odometry[index])) @ T_base_level
        rotation = tilt @ T_base_camera.rotation
        return Observation(self.images[index], self.lens.camera, (index + 1) * 10**9, rotation, T_odom_level)

    @property
    def mirrored(self) -> Drive:
        """The drive as a mirror shows it, through a world whose left is right: a control that fits no place."""
        mirror, turned = np.diag([1.0, -1.0, 1.0]), np.array([1.0, -1.0, -1.0])
        images = np.ascontiguousarray(self.images[:, :, ::-1])
        return replace(self, images=images, odometry=self.odometry * turned, tilts=mirror @ self.tilts @ mirror)

    def turned(self, degrees: float) -> Drive:
        """The drive by a panorama that looks to the left, odometry unchanged: a control that fits no place for long."""
        columns = round(degrees / 360.0 * self.images.shape[2])
        return replace(self, images=np.roll(self.images, columns, axis=2))

    def truth(self, index: int) -> Array:
        """Return x, y, yaw (3,) of the level camera in the map."""
        T_map_base = self.T_map_base[index]
        place = (T_map_base @ self.lens.T_base_camera).translation
        return np.array([place[0], place[1], float(T_map_base.yaw)])


@dataclass(frozen=True)
class Studio:
    """A world of a seed in which drives are recorded; `folder` keeps what was recorded."""

    world: str
    seed: int
    folder: Path

    def record(self, line: Array, seed: int, lens: Lens = PANORAMA, light: LightParams = LIGHTS[0]) -> Drive:
        """Return a drive along planar poses (K, 3) of the base; `seed` decides every noise."""
        rng = np.random.default_rng([self.seed, seed, 71])
        T_map_base = self._on_ground(line)
        key = _key(self.world, self.seed, np.asarray(line).tobytes(), seed, lens, light)
        images = kept(self.folder / f"{key}.npy", lambda: self._images(T_map_base, lens, light, seed))
        return Drive(images, lens, T_map_base, _odometry(line, rng), _tilts(T_map_base, rng))

    def built(self) -> World:
        """Return the world."""
        return build_world(self.world, self.seed, "block")

    def _on_ground(self, line: Array) -> SE3:
        ground, vehicle = self.built().ground, CarParams()
        poses = [ground.follow(SE3.from_planar(*map(float, p)), vehicle.wheelbase, vehicle.width) for p in line]
        return SE3.from_matrix(np.stack([pose.matrix for pose in poses]))

    def _images(self, T_map_base: SE3, lens: Lens, light: LightParams, seed: int) -> NDArray[np.uint8]:
        renderer, traffic = _renderer(self.world, self.seed, light)
        images = []
        for index in range(len(T_map_base.matrix)):
            T_map_camera = T_map_base[index] @ lens.T_base_camera
            if traffic is not None:
                stamp = (seed * 1000 + index) * 10**9  # every drive at another time, an image a second
                renderer.move(traffic.poses(stamp, T_map_camera.translation[None, :2], CLEAR))
            images.append(take(renderer, light, lens.camera, T_map_base[index], T_map_camera, (self.seed, seed, index)))
        return np.stack(images)


def take(
    renderer: Renderer, light: LightParams, camera: Camera, T_map_base: SE3, T_map_camera: SE3, seed: tuple[int, ...]
) -> NDArray[np.uint8]:
    """Return what a camera sees; by night by the car's head lamp, and exposed to a mean grey level."""
    is_night = light.torch > 0.0
    renderer.torch = T_map_base @ T_BASE_TORCH if is_night else None
    levels, _ = renderer.render(camera, T_map_camera, is_gray=True)
    if is_night and not LEVELS[0] < levels.mean() < LEVELS[1]:
        gain = (LEVEL / max(float(levels.mean()), 1.0)) ** light.gamma
        levels, _ = renderer.render(camera, T_map_camera, is_gray=True, gain=min(gain, MAX_GAIN))
    noise = NIGHT_NOISE if is_night else 1.0
    return expose(levels, noise * READ_NOISE, noise**2 * SHOT_NOISE, seed)


@lru_cache(maxsize=2)
def _renderer(world: str, seed: int, light: LightParams) -> tuple[Renderer, Traffic | None]:
    """Return what draws a world, and who moves in it: cars, a tram, bicycles, pedestrians in the town's streets."""
    built = build_world(world, seed, "block")
    traffic = Traffic(built, TrafficParams(density="usual", may_cross=True), seed) if built.loops else None
    return Renderer(built.mesh, shadows_in(light), light, traffic), traffic


def shadows_in(light: LightParams) -> RenderParams:
    """Return how a light is drawn: one is without shadows."""
    return RenderParams(shadow_texel=0.0) if light == SHADOWLESS else RenderParams()


def _odometry(line: Array, rng: np.random.Generator) -> Array:
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


def kept(path: Path, make: Callable[[], NDArray[Any]]) -> NDArray[Any]:
    """Return an array from its file; made and written where there is none."""
    if path.exists():
        return np.asarray(np.load(path, allow_pickle=False))
    made = make()
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_suffix(".part.npy")
    np.save(draft, made, allow_pickle=False)
    draft.replace(path)
    return made


def _key(*parts: object) -> str:
    """Return what all that decides a recording hashes to, the simulator's source included."""
    key = hashlib.sha256(simulator_source())
    for part in parts:
        key.update(part if isinstance(part, bytes) else repr(part).encode())
    return key.hexdigest()[:24]


@lru_cache(maxsize=1)
def simulator_source() -> bytes:
    """Return all source of the simulator: recordings must not outlive it."""
    folder = Path(cycab_sim.__file__).parent
    return b"".join(path.read_bytes() for path in sorted(folder.rglob("*.py")))
