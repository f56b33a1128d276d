"""A world made of one sphere of a map, and recordings in it by cameras whose rows are read one after the other.

The sphere's range is a surface without holes and its image the paint, mirrored beyond its border. Rays of every row
start where the camera is when that row is read, so that nothing is approximated; pose and stamp are the middle row's.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from geometry_msgs.msg import PoseStamped
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image

from benchmarks.room import render
from sphere_nav.geometry import SE3, Camera, Spherical
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.geometry.cameras.rolling_shutter import row_share
from sphere_nav.ros import qos
from sphere_nav.ros.bags.writer import BagWriter
from sphere_nav.ros.conversions import array_to_image, camera_to_info, se3_to_pose_stamped
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere, continued, to_gray_bytes

FRAME, START_NS = "camera_optical", 1_000_000_000
NOISE = 2.0  # grey levels
GRID = 3  # px of the sphere between vertices
STEP_S = 1e-3  # over which the velocity is measured


@dataclass(frozen=True)
class Sway:
    """A way by hand: a walk of `length` m to the left and ahead, with sines that differ by seed (rad, m, 1/s)."""

    seed: int
    turn: float = 0.09
    way: float = 0.10
    speed: float = 0.15

    def pose(self, t: float) -> SE3:
        """Return T_sphere_body at a time in s."""
        rng = np.random.default_rng(self.seed)
        rate, phase = rng.uniform(3.0, 8.0, 6), rng.uniform(0.0, 2.0 * np.pi, 6)
        wave = np.sin(rate * t + phase) * np.repeat([self.way, self.turn], 3)
        drift = self.speed * np.array([0.3, np.cos(self.seed), 0.2]) * np.sin(0.8 * t)
        return SE3.from_parts(SE3.exp([0.0, 0.0, 0.0, *wave[3:]]).rotation, wave[:3] + drift)

    def optical(self, t: float) -> SE3:
        """Return the pose of the camera, optical axes."""
        return self.pose(t) @ T_BODY_OPTICAL

    def twist(self, t: float, readout: float) -> NDArray[np.float64]:
        """Return the motion (6,) of the camera within a readout."""
        moved = self.optical(t - STEP_S).inverse() @ self.optical(t + STEP_S)
        return np.asarray(moved.log() * (readout / (2.0 * STEP_S)), np.float64)


class SphereWorld:
    """The surface that a sphere, whole or a window, shows."""

    def __init__(self, sphere: Sphere) -> None:
        camera, gray = sphere.camera, to_gray_bytes(sphere.image)
        self._margin = 0 if camera.is_whole else min(gray.shape) // 2
        seen = gray > 0
        gray = np.where(seen, gray, cv2.inpaint(gray, (~seen).astype(np.uint8), 3, cv2.INPAINT_TELEA))
        pad = ((self._margin, self._margin),) * 2
        self._gray = np.pad(gray, pad, mode="symmetric")
        range_m = np.pad(continued(sphere.range_m, np.isfinite(sphere.range_m)), pad, mode="edge")
        range_m = cv2.GaussianBlur(range_m.astype(np.float32), (0, 0), 1.5)
        height, width = range_m.shape
        end_u, end_v = width + (1 if camera.is_whole else 0), height
        rows, columns = np.arange(0, end_v, GRID), np.arange(0, end_u + GRID, GRID)
        columns = columns[columns <= end_u - 1 + (GRID if camera.is_whole else 0)]
        self._v, self._u = np.meshgrid(rows.astype(float), columns.astype(float), indexing="ij")
        rays = camera.unproject(np.stack([self._u - self._margin, self._v - self._margin], axis=-1))
        points = rays * range_m[self._v.astype(int), self._u.astype(int) % width][..., None]
        corner = np.arange(points.shape[0] * points.shape[1]).reshape(points.shape[:2])
        a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
        self._triangles = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, c, b), (b, c, d))])
        self._scene = EmbreeScene()
        self._mesh = TriangleMesh(self._scene, points.reshape(-1, 3)[self._triangles].astype(np.float32))

    def render(
        self, camera: Camera, T_sphere_camera: SE3, twist: NDArray[np.float64]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the grey image (H, W), 0 where nothing is, and depth (H, W) m along z, each row from where it was."""
        rows = SE3.exp(row_share(np.arange(camera.height), camera.height)[:, None] * twist)
        T = SE3(T_sphere_camera.matrix @ rows.matrix)
        own = pixel_rays(camera)
        rays = np.einsum("vij,vuj->vui", T.rotation, own)
        starts = np.broadcast_to(T.translation[:, None, :], rays.shape)
        hit = self._scene.run(
            np.ascontiguousarray(starts.reshape(-1, 3), np.float32),
            np.ascontiguousarray(rays.reshape(-1, 3), np.float32),
            query="INTERSECT",
            output=1,
        )
        face = np.maximum(hit["primID"], 0)
        corners = self._triangles[face]
        b, c = hit["u"], hit["v"]
        share = np.stack([1.0 - b - c, b, c], axis=-1)
        u, v = (
            np.sum(plane.ravel()[corners] * share, axis=-1).reshape(camera.height, camera.width).astype(np.float32)
            for plane in (self._u, self._v)
        )
        gray = cv2.remap(self._gray, u, v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_WRAP).astype(np.float32)
        is_seen = (hit["primID"] >= 0).reshape(u.shape)
        depth = hit["tfar"].reshape(u.shape) * own[..., 2]
        return np.where(is_seen, gray, 0.0).astype(np.float32), np.where(is_seen, depth, np.nan).astype(np.float32)


@dataclass(frozen=True)
class Recorded:
    """How a camera records: what it is, what camera_info says it is, its readout in s, images a second."""

    camera: Camera
    given: Camera
    readout: float = 0.0
    rate_hz: float = 30.0


def record(bag: Path, world: SphereWorld, how: Recorded, way: Sway, start_s: float, number: int) -> None:
    """Write images, depth and true poses of the middle rows."""
    rng = np.random.default_rng(way.seed)
    with BagWriter(bag) as writer:
        writer.add_topic("/camera_info", CameraInfo, qos.STATE)
        for topic, kind in (("/image_raw", Image), ("/depth/image_raw", Image), ("/ground_truth/pose", PoseStamped)):
            writer.add_topic(topic, kind, qos.STATE)
        for k in range(number):
            t = start_s + k / how.rate_hz
            stamp = START_NS + round(t * 1e9)
            gray, depth = world.render(how.camera, way.optical(t), way.twist(t, how.readout))
            noisy = np.where(gray > 0, np.clip(np.rint(gray + rng.normal(0.0, NOISE, gray.shape)), 1, 255), 0)
            writer.write("/ground_truth/pose", se3_to_pose_stamped(way.pose(t), stamp, "map"), stamp)
            writer.write("/camera_info", camera_to_info(how.given, stamp, FRAME), stamp)
            writer.write("/depth/image_raw", array_to_image(depth, stamp, FRAME, "32FC1"), stamp)
            writer.write("/image_raw", array_to_image(noisy.astype(np.uint8), stamp, FRAME, "mono8"), stamp)


def room_sphere(camera: Spherical, seed: int) -> Sphere:
    """Return a sphere of the room that most benchmarks use: a world where there is no recording."""
    image, range_m = render(camera, SE3.identity(), seed)
    return Sphere(np.maximum(image, 1), range_m, camera)
