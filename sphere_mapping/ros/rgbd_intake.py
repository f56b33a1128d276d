"""An RGB-D camera by its messages: depth registered to the images, or as its own camera gives it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo

from sphere_mapping.acquisition.partial.depth_registration import DepthRegistration
from sphere_mapping.acquisition.partial.partial_sphere import RgbdView, sphere_from_views
from sphere_mapping.acquisition.partial.window import upright_axes
from sphere_mapping.graph.tracking import Unroll
from sphere_mapping.params import SphereMapperParams
from sphere_mapping.ros.mount import CameraMount
from sphere_nav.geometry import SE3, Camera
from sphere_nav.ros import conversions
from sphere_nav.ros.camera.mounting import read_mounting
from sphere_nav.ros.camera.synchronizer import Instant
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Image, Sphere

IMAGE, INFO, DEPTH = "image_raw", "camera_info", "depth/image_raw"
DEPTH_INFO = "depth/camera_info"  # only where depth is another camera's than the images


@dataclass(frozen=True, eq=False)
class RgbdInstant:
    """What came of one instant: image (H, W[, 3]) uint8, depth (H', W') m along z, and the cameras of both."""

    stamp_ns: int
    image: Image
    depth_m: NDArray[np.floating]
    camera: Camera
    depth_camera: Camera
    T_image_depth: SE3
    is_registered: bool  # depth has been moved to the image's camera, if not by the pose that is given


OnRgbd = Callable[[RgbdInstant], None]


class RgbdIntake:
    """Makes spheres of image and depth.

    `lookup(target, source)` tells T_target_source of two frames, as /tf_static has it, or raises ValueError; the
    parameter `depth_pose` goes before it. `on_rgbd` takes what came in place of a sphere.
    """

    def __init__(
        self, params: SphereMapperParams, lookup: Callable[[str, str], SE3], on_rgbd: OnRgbd | None = None
    ) -> None:
        self._params, self._lookup, self._on_rgbd = params, lookup, on_rgbd
        self._T_given = read_mounting(params.depth_pose, "depth_pose")

    def make(
        self, instant: Instant, mount: CameraMount, info: CameraInfo, depth_info: CameraInfo | None
    ) -> tuple[Sphere, CameraMount, Unroll | None] | None:
        """Return the sphere of an instant and how it is made anew by a velocity; None where `on_rgbd` takes it."""
        found = self._convert(instant, mount.frame_id, info, depth_info)
        if self._on_rgbd is not None:
            self._on_rgbd(found)
            return None
        readout, partial = self._params.camera.readout, self._params.mapper.partial
        mount = replace(mount, T_sphere_body=upright_axes(mount.T_base_body, found.camera))
        view = view_of(found, mount.T_sphere_body @ T_BODY_OPTICAL, is_rolling=readout > 0.0)

        def unroll(velocity: NDArray[np.float64]) -> Sphere:
            return sphere_from_views([replace(view, twist=velocity * readout)], instant.stamp_ns, partial)

        sphere = sphere_from_views([view], instant.stamp_ns, partial)
        return sphere, mount, unroll if readout else None

    def _convert(self, instant: Instant, frame_id: str, info: CameraInfo, depth_info: CameraInfo | None) -> RgbdInstant:
        camera = conversions.camera_from_info(info)
        depth_camera = camera if depth_info is None else conversions.camera_from_info(depth_info)
        for topic, expected in ((IMAGE, camera), (DEPTH, depth_camera)):
            found = instant.images[topic]
            conversions.check_image_size(expected, found.shape[1], found.shape[0])
        depth_frame = frame_id if depth_info is None else depth_info.header.frame_id or frame_id
        is_beside = depth_frame != frame_id
        T_image_depth = self._T_given
        if T_image_depth is None:
            T_image_depth = self._lookup(frame_id, depth_frame) if is_beside else SE3.identity()
        is_registered = depth_camera == camera and not is_beside
        image, depth_m = instant.images[IMAGE], instant.images[DEPTH]
        return RgbdInstant(instant.stamp_ns, image, depth_m, camera, depth_camera, T_image_depth, is_registered)


def view_of(found: RgbdInstant, T_sphere_camera: SE3 = T_BODY_OPTICAL, *, is_rolling: bool = False) -> RgbdView:
    """Return the view of an instant; depth that was registered is registered anew where a pose is given.

    So is depth of another camera under a rolling shutter: rows are straightened in one image.
    """
    T_image_depth, depth_m, camera = found.T_image_depth, found.depth_m, found.camera
    is_off = bool(np.any(T_image_depth.log()))
    is_beside = not found.is_registered and (found.depth_camera != camera or is_off)
    if (found.is_registered and is_off) or (is_beside and is_rolling):
        register = _registration(found.depth_camera, camera, T_image_depth.matrix.tobytes())
        depth_m = register(np.ascontiguousarray(depth_m, np.float32))
    if not is_beside or is_rolling:
        return RgbdView(found.image, depth_m, camera, T_sphere_camera)
    T_sphere_depth = T_sphere_camera @ T_image_depth
    return RgbdView(found.image, depth_m, camera, T_sphere_camera, found.depth_camera, T_sphere_depth)


@lru_cache(maxsize=4)
def _registration(depth_camera: Camera, camera: Camera, T_image_depth: bytes) -> DepthRegistration:
    return DepthRegistration(depth_camera, camera, SE3(np.frombuffer(T_image_depth).reshape(4, 4)))
