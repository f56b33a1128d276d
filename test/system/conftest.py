"""Recordings as bags: a wall with texture for what goes wrong, a town street for the whole chain."""

from collections.abc import Callable, Iterable
from pathlib import Path

import cv2
import numpy as np
import pytest
from tf2_msgs.msg import TFMessage

from cycab_sim.params import LightParams, RenderParams
from cycab_sim.rendering.renderer import Renderer
from cycab_sim.world.worlds import build_world
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.bags import BagWriter
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

OPTICAL_FRAME, BASE, MAP = "camera_optical", "base_link", "map"
SECOND, PERIOD = 1_000_000_000, 100_000_000
SMALL = Pinhole(160, 120, 130.0, 130.0, 79.5, 59.5)
STREET = Pinhole(320, 240, 240.0, 240.0, 159.5, 119.5)
SEED = 7
Message = tuple[str, object, int]  # topic, message, stamp


class Frames:
    def __init__(self, camera: Pinhole) -> None:
        self.camera = camera

    def mount(self, stamp: int) -> Message:
        transform = conversions.se3_to_transform(T_BODY_OPTICAL, stamp, BASE, OPTICAL_FRAME)
        return "/tf_static", TFMessage(transforms=[transform]), stamp

    def info(self, stamp: int) -> Message:
        return "/camera_info", conversions.camera_to_info(self.camera, stamp, OPTICAL_FRAME), stamp

    def image(self, pixels: np.ndarray, stamp: int) -> Message:
        return "/image_raw", conversions.array_to_image(pixels, stamp, OPTICAL_FRAME, "rgb8"), stamp

    def depth(self, depth_m: np.ndarray, stamp: int) -> Message:
        found = conversions.array_to_image(depth_m.astype(np.float32), stamp, OPTICAL_FRAME, "32FC1")
        return "/depth/image_raw", found, stamp

    def truth(self, T_map_base: SE3, stamp: int) -> Message:
        return "/ground_truth/pose", conversions.se3_to_pose_stamped(T_map_base, stamp, MAP), stamp


def write_bag(path: Path, messages: Iterable[Message]) -> Path:
    with BagWriter(path) as bag:
        for topic, message, stamp in messages:
            bag.add_topic(topic, type(message), qos.TF_STATIC if topic == "/tf_static" else qos.STATE)
            bag.write(topic, message, stamp)
    return path


def wall() -> tuple[np.ndarray, np.ndarray]:
    """Return an image of smooth noise and its depth: a slanted wall 2...4 m away."""
    noise = np.random.default_rng(SEED).integers(0, 255, (SMALL.height, SMALL.width, 3), np.uint8)
    depth = np.broadcast_to(np.linspace(2.0, 4.0, SMALL.width), (SMALL.height, SMALL.width))
    return cv2.GaussianBlur(noise, (0, 0), 2.0), depth.copy()


def wall_messages() -> list[Message]:
    frames, (pixels, depth_m) = Frames(SMALL), wall()
    messages = [frames.mount(SECOND)]
    for stamp in range(SECOND, SECOND + 3 * PERIOD, PERIOD):
        parts = (frames.truth(SE3.identity(), stamp), frames.info(stamp))
        messages += [*parts, frames.depth(depth_m, stamp), frames.image(pixels, stamp)]
    return messages


@pytest.fixture(scope="session")
def street() -> Callable[[SE3], tuple[np.ndarray, np.ndarray]]:
    """Render image and depth along z of a street from T_map_base, base in body axes, sky unknown."""
    # a coarse shadow map: nothing here depends on how sharp shadows are
    world = build_world("ramp", SEED)
    renderer = Renderer(world.mesh, RenderParams(shadow_texel=0.25), LightParams(), bounds=world.bounds)
    rays = STREET.unproject(pixel_grid(STREET))
    z_of_range = rays[..., 2] / np.linalg.norm(rays, axis=-1)

    def look(T_map_base: SE3) -> tuple[np.ndarray, np.ndarray]:
        pixels, range_m = renderer.render(STREET, T_map_base @ T_BODY_OPTICAL)
        depth_m = np.where(np.isfinite(range_m), range_m, np.nan) * z_of_range
        return np.clip(np.rint(pixels), 0, 255).astype(np.uint8), depth_m

    return look
