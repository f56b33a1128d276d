"""The node `mcl_depth`: panoramas in, pose, particles and status out. Every image is answered by a status."""

from __future__ import annotations

import time

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from numpy.typing import NDArray
from sensor_msgs.msg import Image
from std_srvs.srv import Empty

from localization.status import FINE, FOLLOWING, Finding
from mcl_depth.belief.estimate import Observation
from mcl_depth.clouds_node import Clouds
from mcl_depth.filter import Filter
from mcl_depth.homing_node import HomingGuide
from mcl_depth.intake_node import Intake
from mcl_depth.likeness.comparison import check_headings
from mcl_depth.outputs_node import Outputs
from mcl_depth.params import MclDepthParams
from mcl_depth.views_node import Views
from mcl_depth.warm_up import warm_up
from node_kit import conversions, qos
from node_kit.companion import Companion
from node_kit.node import ManagedNode
from node_kit.run import run
from sphere_geometry import SE3

WATCH_PERIOD = 0.25  # s between two looks at a silent camera


class MclDepthNode(ManagedNode):
    """Converts, asks the filter, converts back."""

    NAME = "mcl_depth"
    PARAMS = MclDepthParams
    params: MclDepthParams

    def configure(self) -> None:
        """Open topics, services and the cloud."""
        check_headings(self.params.heading_step_deg, self.params.synthesis.num_columns)
        warm_up(self.params)
        self.filter: Filter | None = None
        self.given: tuple[SE3, NDArray[np.float64]] | None = None  # pose of the base that waits for the first image
        self.clouds = Clouds(self)
        self.outputs, self.views, self.guide = Outputs(self), Views(self), HomingGuide(self)
        self.intake = Intake(self, self.params, self.on_image)
        self.add_subscription(
            "initialpose", PoseWithCovarianceStamped, self.on_initial_pose, qos.STATE, is_required=False
        )
        self.add_service("reinitialize_global_localization", Empty, self.on_reinitialize)
        self.companion = Companion(self, self.params.map_frame, self.needs_help, self.start)
        self.arrival_ns = 0  # of the last image, on the node's clock
        self.add_timer(WATCH_PERIOD, self.on_watch)

    def clock_jumped(self) -> None:
        """Forget the stream; the pose is searched anew."""
        self.intake.odometry.clear()
        self.arrival_ns = 0
        self.companion.clear()
        if self.filter is not None:
            self.filter.reset()

    def on_watch(self) -> None:
        """Say so when images stay away, by the node's clock: stamps may be those of a recording."""
        elapsed_s = (self.now_ns() - self.arrival_ns) * 1e-9
        status = self.filter.silence(elapsed_s) if self.filter is not None and self.arrival_ns else None
        if status is not None:
            self.outputs.tell(status)

    def on_image(self, message: Image, fault: Finding) -> None:
        """Answer one image."""
        try:
            self.answer(message, fault)
        finally:
            self.arrival_ns = self.now_ns()  # after the work: time spent here is no silence

    def answer(self, message: Image, fault: Finding) -> None:
        """Localise one image and publish the result, or at least the status."""
        started, stamp = time.perf_counter(), conversions.stamp_ns(message)
        camera = self.intake.camera
        if fault is FINE and camera is not None and self.filter is None:
            self.begin()
        if self.filter is None:
            self.outputs.tell(self.clouds.status(stamp, fault))
            return
        if fault is not FINE or camera is None:
            status = self.filter.refuse(stamp, fault).status
            self.guide.answer(None, status, stamp)
            self.outputs.tell(status)
            return
        grey = conversions.image_to_grey(message)
        observation = Observation(grey, camera, stamp, self.intake.rotation(), self.intake.T_odom_level(stamp))
        estimate = self.filter.update(observation)
        if estimate.belief is not None:
            self.views.show(estimate.belief, self.filter, stamp)
        self.guide.answer(estimate.belief, estimate.status, stamp)
        self.outputs.publish(estimate, stamp, (time.perf_counter() - started) * 1e3)

    def begin(self) -> None:
        """Make the filter, now that the camera's height is known; start where a pose was given before."""
        self.filter = self.clouds.make_filter(float(self.intake.T_base_level.translation[2]))
        if self.filter is None or self.given is None:
            return
        try:
            self.start(*self.given)
        except ValueError as error:  # it came before the map: search everywhere
            self.log.error(f"initialpose: refused: {error}")

    def needs_help(self) -> bool:
        """Whether another localiser's pose is of use: there is a filter, and no pose."""
        return self.filter is not None and self.outputs.state not in FOLLOWING

    def on_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        """Search around a given pose of the base, at once or with the first image that can be compared."""
        given = conversions.pose_with_covariance_to_se3(message, self.params.map_frame)
        if self.filter is None:
            self.given = given
        else:
            self.start(*given)

    def start(self, T_map_base: SE3, covariance: NDArray[np.float64]) -> None:
        """Search around a pose of the base; ValueError for one off the map."""
        self.given = None
        assert self.filter is not None
        self.filter.start(T_map_base @ self.intake.T_base_level, covariance)

    def on_reinitialize(self, request: Empty.Request, response: Empty.Response) -> Empty.Response:
        """Search everywhere."""
        self.given = None
        if self.filter is not None:
            self.filter.search()
        return response


def main() -> int:
    """Run the node."""
    return run(MclDepthNode)
