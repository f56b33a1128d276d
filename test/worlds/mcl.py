"""A furnished room, a panoramic camera driven through it, and the node mcl_depth on an offline bus before it."""

from __future__ import annotations

import numpy as np
from tf2_msgs.msg import TFMessage

from mcl_depth.geometry.cloud import Geometry
from mcl_depth.geometry.mesh import mesh_from_faces, sample_surface
from mcl_depth.geometry.synthesis import DepthSynthesizer
from mcl_depth.params import SynthesisParams
from mcl_depth.ros.node import MclDepthNode
from sphere_nav.geometry import SE3
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions import (
    array_to_image,
    camera_to_sphere_info,
    se3_to_odometry,
    se3_to_pose_with_covariance,
    se3_to_transform,
)

SECOND = 10**9
HEIGHT = 1.2
COLUMNS = 180
BOXES = (  # the room, furniture, and a doorway in the wall
    ((-4, -2.5, 0), (4, 3, 2.6)),
    ((1.0, 1.8, 0), (2.6, 3.0, 2.0)),
    ((-4, 1.6, 0), (-3, 3.0, 1.7)),
    ((3.0, -2.5, 0), (4, -1.2, 1.8)),
    ((-1.0, -2.5, 0), (-0.1, -2.4, 2.1)),
)
SETTINGS = {"area.step": 0.25, "resampling.num_particles": 400, "synthesis.num_columns": COLUMNS}
SETTINGS |= {"likeness.kind": "gradients"}  # of pictures that no camera took nothing was learned
T_BASE_EYE = SE3.from_parts(np.eye(3), np.array([0.2, 0.0, HEIGHT]))
T_ODOM_MAP = SE3.from_planar(3.0, 1.0, 2.0)


def room() -> Geometry:
    """Return the surfaces."""
    vertices, faces = [], []
    for number, (low, high) in enumerate(BOXES):
        vertices += [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
        for a, b, c, d in ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)):
            faces += [[8 * number + i for i in (a, b, c)], [8 * number + i for i in (a, c, d)]]
    return mesh_from_faces(np.array(vertices, float), np.array(faces), "room")


def room_points(spacing=0.05) -> np.ndarray:
    """Return points of the surfaces."""
    return sample_surface(room(), spacing).points


def drive(count=12) -> list[SE3]:
    """Return poses of the base on a bend through the room."""
    yaws = np.radians(2.0 * np.arange(count))  # whole columns of the panorama
    eyes = [SE3.from_planar(-2.4 + 0.3 * k, -0.9 + 0.03 * k * k, float(yaw)) for k, yaw in enumerate(yaws)]
    return [eye @ SE3.from_planar(-0.2, 0.0, 0.0) for eye in eyes]


class Eye:
    """What the panoramic camera sees: surfaces are the brighter the nearer to the middle, with a little noise.

    `is_lit`: the nearer to a lamp on the camera, which moves with it.
    """

    def __init__(self, *, is_lit: bool = False) -> None:
        self._is_lit = is_lit
        self._synthesizer = DepthSynthesizer(room(), SynthesisParams(num_columns=COLUMNS))
        self.camera = self._synthesizer.camera

    def picture(self, T_map_base: SE3) -> np.ndarray:
        eye = T_map_base @ T_BASE_EYE
        depth = self._synthesizer.synthesize_many([[*eye.translation[:2], HEIGHT]])[0]
        place = np.array([*eye.translation[:2], HEIGHT])
        middle = np.linalg.norm(place + depth[..., None] * self.camera.unproject(pixel_grid(self.camera)), axis=-1)
        bright = np.roll(
            255.0 / (1.0 + 0.3 * (depth if self._is_lit else middle)),
            round(float(eye.yaw) / (2 * np.pi) * COLUMNS),
            axis=1,
        )
        noise = np.random.default_rng(int(1e6 * abs(eye.translation[0]))).normal(0.0, 2.0, bright.shape)
        return np.clip(bright + noise, 0, 255).astype(np.uint8)


class Bench:
    """The node and its world; every image is a second after the last."""

    def __init__(self, eye, cloud="", *, is_calibrated=True, remap=None, bus=None, **values):
        given = {name.replace("__", "."): value for name, value in values.items()}
        self.eye, self.now = eye, SECOND
        self.bus = bus or OfflineBus()
        self.node = self.bus.add(MclDepthNode, {"cloud": str(cloud)} | SETTINGS | given, remap)
        self.send("/tf_static", TFMessage(transforms=[se3_to_transform(T_BASE_EYE, self.now, "base_link", "eye")]))
        if is_calibrated:
            self.send("/sphere_info", camera_to_sphere_info(eye.camera, "eye"))

    def send(self, topic, message):
        """Send a message; return what was said to it."""
        self.bus.publish(topic, message)
        return [record for record in self.bus.settle() if record.topic != topic]

    def see(self, T_map_base, *, T_odom_base=None, has_odometry=True):
        """Send odometry and an image; return the last message by topic."""
        self.now += SECOND
        said = list(self.bus.advance(self.now))
        if has_odometry:
            odometry = T_odom_base or T_ODOM_MAP @ T_map_base
            message = se3_to_odometry(odometry, 1e-4 * np.eye(6), self.now, ("odom", "base_link"))
            said += self.send("/odom", message)
        said += self.send("/image_raw", array_to_image(self.eye.picture(T_map_base), self.now, "eye", "mono8"))
        return {record.topic: record.message for record in said}

    def follow(self, poses):
        """See all of it; return the answers."""
        return [self.see(pose) for pose in poses]

    def follow_from(self, poses):
        """See all of it, told where it begins: in a room, a place takes long to prove."""
        covariance = np.diag([0.2, 0.2, 0.1, 0.1, 0.1, 0.1]) ** 2
        self.send("/initialpose", se3_to_pose_with_covariance(poses[0], covariance, self.now, "map"))
        return self.follow(poses)
