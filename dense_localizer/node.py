"""The node `dense_localizer`: images in, pose and status out. Every image is answered by a status."""

from __future__ import annotations

import time

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from numpy.typing import NDArray
from sensor_msgs.msg import Image

from dense_localizer.calls_node import OperatorCalls
from dense_localizer.intake_node import Intake, Picture
from dense_localizer.localizer import Localizer
from dense_localizer.outputs_node import Outputs
from dense_localizer.params import DenseLocalizerParams
from localization.status import FOLLOWING, Finding, Reason, State, status_of
from node_kit import conversions, qos
from node_kit.companion import Companion
from node_kit.map_bag import MapReader, open_map
from node_kit.node import ManagedNode
from node_kit.run import run
from photometric import warm_up
from sphere_geometry import SE3

WATCH_PERIOD = 0.25  # s between two looks at a silent camera


class DenseLocalizerNode(ManagedNode):
    """Converts, asks the localiser, converts back."""

    NAME = "dense_localizer"
    PARAMS = DenseLocalizerParams
    params: DenseLocalizerParams

    def configure(self) -> None:
        """Open topics, services and the map."""
        warm_up()
        self.map: MapReader | None = None
        self.localizer: Localizer | None = None
        if self.params.map:
            self.load_map(self.params.map)
        self.given: SE3 | None = None  # initial pose of the base, until the camera's place on it is known
        self.arrival_ns = 0  # of the last image, on the node's clock
        self.outputs = Outputs(self)
        self.intake = Intake(self, self.params, self.on_image)
        self.add_subscription(
            "initialpose", PoseWithCovarianceStamped, self.on_initial_pose, qos.STATE, is_required=False
        )
        self.add_timer(WATCH_PERIOD, self.on_watch)
        OperatorCalls(self)
        self.companion = Companion(self, self.params.map_frame, self.needs_help, self.take_offer)

    def cleanup(self) -> None:
        """Close the map."""
        if self.map is not None:
            self.map.close()

    def clock_jumped(self) -> None:
        """Forget the stream; the pose is searched anew."""
        self.intake.odometry.clear()
        self.arrival_ns = 0
        self.companion.clear()
        if self.localizer is not None:
            self.localizer.reset()

    def load_map(self, path: str) -> None:
        """Use another map; ValueError leaves the present one in force."""
        opened, before = open_map(path), self.map
        self.map, self.localizer = opened, Localizer(self.params, opened)
        if before is not None:
            before.close()

    def on_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        """Search around a given pose of the base; ValueError for a wrong frame, NaN, or a pose far off the map."""
        T_map_base, _ = conversions.pose_with_covariance_to_se3(message, self.params.map_frame)
        if self.localizer is None:
            raise ValueError("initial pose: expected a map, found none: load one first")
        self.localizer.relocalize(T_map_base @ self.intake.T_base_camera)
        self.given = None if self.intake.is_mounted else T_map_base  # once more when it is known where the camera is

    def needs_help(self) -> bool:
        """Whether another localiser's pose is of use: there is a map, and no pose."""
        return self.localizer is not None and self.intake.is_mounted and self.outputs.state not in FOLLOWING

    def take_offer(self, T_map_base: SE3, _: NDArray[np.float64]) -> None:
        """Search around the pose that another localiser found; ValueError for one far off the map."""
        assert self.localizer is not None
        estimate = self.localizer.relocalize(T_map_base @ self.intake.T_base_camera)
        if estimate is not None:
            self.outputs.tell(estimate.status)

    def on_watch(self) -> None:
        """Say so when images stay away, by the node's clock: stamps may be those of a recording."""
        elapsed_s = (self.now_ns() - self.arrival_ns) * 1e-9
        status = self.localizer.silence(elapsed_s) if self.localizer is not None and self.arrival_ns else None
        if status is not None:
            self.outputs.tell(status)

    def on_image(self, message: Picture, fault: Finding) -> None:
        """Answer one image."""
        try:
            self.answer(message, fault)
        finally:
            self.arrival_ns = self.now_ns()  # after the work: time spent here is no silence

    def answer(self, message: Picture, fault: Finding) -> None:
        """Localise one image and publish the result, or at least the status."""
        started, stamp = time.perf_counter(), conversions.stamp_ns(message)
        camera = self.intake.camera
        if self.localizer is None:
            self.outputs.tell(status_of(State.NO_MAP, stamp, fault))
            return
        if camera is None or fault.reason is not Reason.NONE:
            self.outputs.tell(self.localizer.refuse(stamp, fault).status)
            return
        try:
            is_raw = isinstance(message, Image)
            image = conversions.image_to_grey(message if is_raw else conversions.compressed_to_image(message))
        except ValueError as error:
            fault = Finding(Reason.BAD_INFO, detail=str(error))
            self.outputs.tell(self.localizer.refuse(stamp, fault).status)
            raise
        if self.given is not None:
            self.localizer.relocalize(self.given @ self.intake.T_base_camera)
            self.given = None
        estimate = self.localizer.update(image, camera, stamp, self.intake.T_odom_camera(stamp))
        self.outputs.publish(estimate, (time.perf_counter() - started) * 1e3)
        self.outputs.show(estimate, image, camera)


def main() -> int:
    """Run the node."""
    return run(DenseLocalizerNode)
