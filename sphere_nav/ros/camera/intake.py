"""The camera of a localiser, or several that are fixed to one another, and odometry at their stamps."""

from __future__ import annotations

from collections.abc import Callable

from sphere_nav.geometry import SE3, Camera
from sphere_nav.localization.params import NodeParams
from sphere_nav.localization.status import FINE, Finding
from sphere_nav.ros.camera.mounting import read_mounting
from sphere_nav.ros.camera.odometry_input import OdometryInput
from sphere_nav.ros.camera.stream import CameraStream, Fixture, Picture
from sphere_nav.ros.endpoints import Endpoints
from sphere_nav.ros.subscription import Subscription
from sphere_nav.ros.tf import TransformListener
from sphere_nav.spheres.sphere import T_BODY_OPTICAL


class CameraIntake:
    """Hands every image of one camera on, in order, as a `Picture` or with what is wrong with it."""

    def __init__(
        self,
        endpoints: Endpoints,
        params: NodeParams,
        on_picture: Callable[[Picture], None],
        on_refusal: Callable[[int, Finding], None],
        *,
        has_sphere_info: bool = False,
    ) -> None:
        """`on_refusal(stamp_ns, finding)` gets the images that cannot be used; `has_sphere_info` allows panoramas."""
        self._tf = TransformListener(endpoints, ignored=params.map_frame)
        self.odometry = OdometryInput(endpoints, self._tf.tree, params.base_frame, is_used=params.use_odometry)
        mounting = read_mounting(params.mounting)
        T_base_camera = mounting @ T_BODY_OPTICAL if mounting is not None else None
        fixture = Fixture(T_base_camera=(lambda: T_base_camera) if T_base_camera is not None else None)
        shared = endpoints, params, self._tf, self.odometry, fixture
        self._stream = CameraStream(*shared, on_picture, on_refusal, has_sphere_info=has_sphere_info)

    def clear(self) -> None:
        """Forget what has a stamp: the clock jumped."""
        self.odometry.clear()
        self._tf.tree.clear()
        self._stream.clear()

    def forget_camera(self) -> None:
        """Accept the next calibration, frames and odometry as new ones."""
        self._stream.forget_camera()
        self.odometry.reset()

    @property
    def images(self) -> Subscription:
        """The topic of the images: how many came, were refused, were lost."""
        return self._stream.images

    @property
    def fault(self) -> Finding:
        """Nothing: what is wrong with the only camera is the answer to its images."""
        return FINE

    @property
    def camera(self) -> Camera | None:
        """The camera, once it is known."""
        return self._stream.camera

    @property
    def is_mounted(self) -> bool:
        """Whether it is known where the camera is on the base."""
        return self._stream.T_base_camera is not None

    @property
    def T_base_camera(self) -> SE3:
        """The camera on the base, optical axes; identity before it is known."""
        return self._stream.T_base_camera or SE3.identity()
