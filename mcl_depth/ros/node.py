"""The node `mcl_depth`: the localiser in bare geometry (sphere_nav/ros/localizer/node.py is around it)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import Imu
from std_srvs.srv import Empty

from mcl_depth.belief.estimate import Estimate, Observation
from mcl_depth.belief.motion_model import planar_pose
from mcl_depth.filter import Filter
from mcl_depth.likeness.kinds import check_headings, check_likeness
from mcl_depth.params import MclDepthParams
from mcl_depth.ros.clouds import NO_CLOUD, GeometryLoader
from mcl_depth.ros.views import HomingGuide, Views
from mcl_depth.warm_up import warm_up
from sphere_nav.geometry import SE3, so3
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.status import FINE, BaseEstimate, Status, Verdict
from sphere_nav.ros import qos
from sphere_nav.ros.camera.stream import Picture
from sphere_nav.ros.conversions.poses import imu_attitude
from sphere_nav.ros.endpoints import Endpoints
from sphere_nav.ros.localizer.node import LocalizerNode
from sphere_nav.ros.run import run


class MclDepthNode(LocalizerNode):
    """Converts, asks the filter, converts back."""

    NAME = "mcl_depth"
    PARAMS = MclDepthParams
    NO_MAP = NO_CLOUD
    params: MclDepthParams

    def configure(self) -> None:
        """Open topics, services and the cloud."""
        p, endpoints = self.params, self.endpoints
        check_headings(p)
        check_likeness(p)
        warm_up(p)
        self.filter: Filter | None = None
        self.clouds = GeometryLoader(endpoints, p, self.drop_filter)
        self.attitude = Attitude(endpoints, p.roll_deg, p.pitch_deg)
        self.views, self.guide = Views(endpoints, p.map_frame), HomingGuide(endpoints, p)
        super().configure()
        self.add_service("~/reinitialize_global_localization", Empty, self.on_reinitialize)

    def cleanup(self) -> None:
        """Give the memory back."""
        self.drop_filter()

    def drop_filter(self) -> None:
        """Use another geometry from the next image on."""
        self.filter = None

    @property
    def is_ready(self) -> bool:
        """Whether there is a filter: a cloud, and a camera whose height is known."""
        return self.filter is not None

    @property
    def has_map(self) -> bool:
        """Whether there is a geometry."""
        return self.clouds.geometry is not None

    @property
    def map_id(self) -> str:
        """The name of the map in use, where it is one of key spheres."""
        return self.clouds.geometry.map_id if self.clouds.geometry is not None else ""

    def prepare(self, picture: Picture) -> None:
        """Make the filter, now that the camera and its height are known."""
        if self.filter is None:
            self.filter = self.clouds.make_filter(picture.camera, float(picture.T_base_camera.translation[2]))

    def localize(self, picture: Picture) -> BaseEstimate:
        """Localise one image; show what it made of the belief."""
        stamp, T_base_level, tilt = picture.stamp_ns, level(picture.T_base_camera), self.attitude.tilt
        if self.filter is None:
            return BaseEstimate(self.refuse(stamp, FINE))
        T_odom_base = picture.T_odom_base
        odometry = planar_pose(T_odom_base @ T_base_level) if T_odom_base is not None else None
        rotation = tilt @ picture.T_base_camera.rotation
        estimate = self.filter.update(Observation(picture.image, picture.camera, stamp, rotation, odometry))
        if estimate.belief is not None:
            self.views.show(estimate.belief, self.filter, stamp)
        self.guide.answer(estimate.belief, estimate.status, stamp)
        found = to_base(estimate, T_base_level, tilt)
        self.clouds.tell_fix(found, stamp)
        return found

    def refuse(self, stamp_ns: int, finding: Verdict) -> Status:
        """Return the status of an image that cannot be used."""
        if self.filter is None:
            return self.clouds.status(stamp_ns, finding)
        status = self.filter.refuse(stamp_ns, finding).status
        self.guide.answer(None, status, stamp_ns)
        return status

    def silence(self, elapsed_s: float, finding: Verdict) -> Status | None:
        """Return what to say of a silent camera."""
        return self.filter.silence(elapsed_s, finding) if self.filter is not None else None

    def needs_help(self) -> bool:
        """Whether another localiser's pose is of use: not while one that it gave is being confirmed."""
        return super().needs_help() and not (self.filter is not None and self.filter.evidence.is_on_trial)

    def relocalize(self, given: tuple[SE3, Array] | None) -> BaseEstimate | None:
        """Search around a pose of the base, or everywhere, with the images to come."""
        if self.filter is not None and given is None:
            self.filter.search()
        elif self.filter is not None and given is not None:
            T_map_base, covariance = given
            self.filter.start(T_map_base @ level(self.intake.T_base_camera), covariance)
        return None

    def forget(self) -> None:
        """Forget pose and stream."""
        if self.filter is not None:
            self.filter.reset()

    def on_reinitialize(self, request: Empty.Request, response: Empty.Response) -> Empty.Response:
        """Search everywhere."""
        self.given = None
        self.relocalize(None)
        return response


def level(T_base_camera: SE3) -> SE3:
    """Return T_base_level: the camera's centre with the axes of the base."""
    return SE3.from_parts(np.eye(3), T_base_camera.translation)


def to_base(estimate: Estimate, T_base_level: SE3, tilt: Array) -> BaseEstimate:
    """Return what an estimate of the levelled camera says about the base."""
    pose = estimate.T_map_level
    if pose is None or estimate.covariance is None:
        return BaseEstimate(estimate.status)
    T_base_upright = T_base_level @ SE3.from_parts(tilt.T, np.zeros(3))
    Ad = T_base_upright.adjoint()
    return BaseEstimate(estimate.status, pose @ T_base_upright.inverse(), Ad @ estimate.covariance @ Ad.T)


def main() -> int:
    """Run the node."""
    return run(MclDepthNode)


class Attitude:
    """`tilt` (3, 3) turns axes of the base into level ones; yaw is not in it."""

    def __init__(self, endpoints: Endpoints, roll_deg: float, pitch_deg: float) -> None:
        roll, pitch = np.radians([roll_deg, pitch_deg])
        self.tilt: NDArray[np.float64] = so3.exp([0.0, pitch, 0.0]) @ so3.exp([roll, 0.0, 0.0])
        endpoints.add_subscription("imu", Imu, self._on_imu, qos.SENSOR, is_required=False)

    def _on_imu(self, message: Imu) -> None:
        attitude = so3.from_quaternion(imu_attitude(message))
        yaw = float(np.arctan2(attitude[1, 0], attitude[0, 0]))
        self.tilt = so3.exp([0.0, 0.0, -yaw]) @ attitude
