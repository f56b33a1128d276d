"""A textured room with exact range, mapped by whole spheres on a line, and drives through it."""

from __future__ import annotations

from functools import cache

import numpy as np

from dense_localizer.judge.estimate import CameraEstimate
from dense_localizer.judge.integrity import Integrity, align_rig
from dense_localizer.localizer import Localizer
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from sphere_nav.geometry import SE3, Fisheye, Pinhole, Spherical
from sphere_nav.params import build
from sphere_nav.spheres.appearance.features import features_of_sphere
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.coarse import coarse_sphere
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere
from worlds.room import Room, wide_room

STEP_NS = 50_000_000  # 20 images a second
PINHOLE = Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5)
FISHEYE = Fisheye(160, 120, 60.0, 60.0, 79.5, 59.5, (0.02, -0.01, 0.0, 0.0))
WIDE_ROOM = wide_room()
# The images are sixteen times smaller than a camera's.
SMALL_IMAGES = {"acceptance.min_pixels": 200, "alignment.num_levels": 4}
features = cache(features_of_sphere)


class MemoryMap:
    """A map that needs no file."""

    T_base_sphere = None

    def __init__(self, nodes) -> None:
        self.graph = SphereGraph(nodes)
        self.num_loaded = 0

    def load_sphere(self, sphere_id: int) -> Sphere:
        self.num_loaded += 1
        sphere = self.graph[sphere_id].sphere
        assert sphere is not None
        return sphere

    def appearance(self) -> AppearanceIndex:
        index = AppearanceIndex()
        for node in self.graph:
            index.add(node.id, features(node.sphere))
        return index

    def coarse_spheres(self) -> dict[int, Sphere]:
        return {node.id: coarse_sphere(node.sphere) for node in self.graph if node.sphere is not None}


def make_map(room: Room, places: list[SE3], camera: Spherical | None = None) -> MemoryMap:
    """Return a map of the room with a sphere at every place."""
    camera = camera or Spherical(512, 256)
    return MemoryMap(KeySphere(i, 1 + i, T, room.sphere(T, camera, i)) for i, T in enumerate(places))


@cache
def wide_map(*along: float) -> MemoryMap:
    """Return a map of the wide room with spheres at x = `along`; it is made once in a process."""
    return make_map(WIDE_ROOM, [SE3.from_planar(x, 0.0, 0.0) for x in along])


@cache
def picture(number: int) -> np.ndarray:
    """Return what a camera sees of the wide room on the drive."""
    return WIDE_ROOM.photograph(PINHOLE, drive(number + 1)[number], number)


def at(x: float, y: float = 0.0, yaw: float = 0.0, z: float = 0.0) -> SE3:
    """Return the pose T_room_camera of a level camera looking along `yaw`."""
    return SE3.from_parts(SE3.from_planar(0, 0, yaw).rotation, [x, y, z]) @ T_BODY_OPTICAL


def drive(number: int, speed: float = 1.0) -> list[SE3]:
    """Return poses along the row of spheres, with a gentle weave in y, heading and height."""
    t = np.arange(number) * STEP_NS * 1e-9
    rows = zip(-1.6 + speed * t, 0.15 * np.sin(2 * t), 0.2 * np.sin(1.5 * t), 0.05 * np.sin(3 * t), strict=True)
    return [at(*row) for row in rows]


def make_localizer(sphere_map, **values) -> Localizer:
    """Return a localiser; names of parameters have __ for dots."""
    given = {name.replace("__", "."): value for name, value in values.items()}
    return Localizer(build(LocalizerParams, SMALL_IMAGES | given), sphere_map)


def locate(images, references, params, prediction: Prediction):
    """Return a pose candidate of images of one body."""
    chosen = references.choose_rig(images, prediction)
    return Integrity(references, params).assess(chosen, align_rig(chosen, prediction, params), prediction)


class Run:
    """Feeds images to a localiser and keeps what it says."""

    def __init__(self, room: Room, localizer: Localizer, camera=PINHOLE) -> None:
        self.room, self.localizer, self.camera = room, localizer, camera
        self.stamp_ns = 1_000_000_000
        self.count = 0

    def see(self, T_room_camera: SE3, edit=lambda image: image, step_ns: int = STEP_NS):
        """Take an image at a pose, change it, localise it."""
        self.count += 1
        self.stamp_ns += step_ns
        image = edit(self.room.photograph(self.camera, T_room_camera, self.count))
        return self.localizer.update(image, self.camera, self.stamp_ns)

    def sweep(self, before: SE3, now: SE3, readout_s: float):
        """Take an image with a rolling shutter while the camera moves as since the last image; localise it."""
        twist = (before.inverse() @ now).log() * readout_s / (STEP_NS * 1e-9)
        return self.see(now, lambda _: np.rint(self.room.render_rolling(self.camera, now, twist)).astype(np.uint8))

    def follow(self, poses):
        """Localise along poses; return the estimates."""
        return [self.see(pose) for pose in poses]


def error(estimate: CameraEstimate, truth: SE3) -> tuple[float, float]:
    """Return metres and radians between an estimate and the truth."""
    assert estimate.T_map_camera is not None
    distance, angle = estimate.T_map_camera.distance(truth)
    return float(distance), float(angle)
