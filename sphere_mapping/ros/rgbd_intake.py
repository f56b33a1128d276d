"""An RGB-D camera by its messages: depth registered to the images, or as its own camera gives it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from sensor_msgs.msg import CameraInfo

from sphere_mapping.acquisition.partial.depth_registration import DepthRegistration
from sphere_mapping.acquisition.partial.partial_sphere import RgbdView, sphere_from_view
from sphere_mapping.acquisition.partial.window import upright_axes
from sphere_mapping.graph.tracking import Unroll
from sphere_mapping.params import SphereMapperParams
from sphere_mapping.ros.mount import CameraMount
from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.arrays import Array
from sphere_nav.ros import conversions
from sphere_nav.ros.camera.mounting import read_mounting
from sphere_nav.ros.camera.synchronizer import Instant
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere

IMAGE, INFO, DEPTH = "image_raw", "camera_info", "depth/image_raw"
DEPTH_INFO = "depth/camera_info"  # only where depth is another camera's than the images


class RgbdIntake:
    """Makes spheres of image and depth.

    `lookup(target, source)` tells T_target_source of two frames, as /tf_static has it, or raises ValueError; the
    parameter `depth_pose` goes before it.
    """

    def __init__(self, params: SphereMapperParams, lookup: Callable[[str, str], SE3]) -> None:
        self._params, self._lookup = params, lookup
        self._T_given = read_mounting(params.depth_pose, "depth_pose")

    def make(
        self, instant: Instant, mount: CameraMount, info: CameraInfo, depth_info: CameraInfo | None
    ) -> tuple[Sphere, CameraMount, Unroll | None]:
        """Return the sphere of an instant and how it is made anew by a velocity."""
        readout, partial = self._params.camera.readout, self._params.mapper.partial
        camera = conversions.camera_from_info(info)
        depth_camera = camera if depth_info is None else conversions.camera_from_info(depth_info)
        for topic, expected in ((IMAGE, camera), (DEPTH, depth_camera)):
            found = instant.images[topic]
            conversions.check_image_size(expected, found.shape[1], found.shape[0])
        mount = replace(mount, T_sphere_body=upright_axes(mount.T_base_body, camera))
        depth_frame = mount.frame_id if depth_info is None else depth_info.header.frame_id or mount.frame_id
        view = self._view(instant, camera, depth_camera, depth_frame, mount)

        def unroll(velocity: Array) -> Sphere:
            return sphere_from_view(replace(view, twist=velocity * readout), instant.stamp_ns, partial)

        sphere = sphere_from_view(view, instant.stamp_ns, partial)
        return sphere, mount, unroll if readout else None

    def _view(
        self, instant: Instant, camera: Camera, depth_camera: Camera, depth_frame: str, mount: CameraMount
    ) -> RgbdView:
        """Return the view of an instant, its depth as the camera of the image would see it."""
        T_image_depth, depth_m = self._T_given, instant.images[DEPTH]
        if T_image_depth is None:
            is_other = depth_frame != mount.frame_id
            T_image_depth = self._lookup(mount.frame_id, depth_frame) if is_other else SE3.identity()
        if depth_camera != camera or np.any(T_image_depth.log()):
            register = DepthRegistration.between(depth_camera, camera, T_image_depth)
            depth_m = register(np.ascontiguousarray(depth_m, np.float32))
        return RgbdView(instant.images[IMAGE], depth_m, camera, mount.T_sphere_body @ T_BODY_OPTICAL)
