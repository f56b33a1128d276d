"""The node `mcl_depth`: panoramas in, pose, particles and status out. Every image is answered by a status."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from sensor_msgs.msg import Image
from sphere_nav_msgs.msg import LocalizationStatus, ParticleCloud
from std_srvs.srv import Empty

from localization_status import TRUSTED, State, Status
from mcl_depth.cloud import Cloud
from mcl_depth.clouds_node import CloudCalls, read_map
from mcl_depth.estimate import Estimate, Look, pose_of
from mcl_depth.filter import Filter
from mcl_depth.intake_node import Intake
from mcl_depth.mesh import TriangleMesh
from mcl_depth.orientation import peaks
from mcl_depth.params import MclDepthParams
from mcl_depth.reasons import FINE, Finding
from mcl_depth.site import Site
from mcl_depth.status import status_of
from node_kit import conversions, qos
from node_kit.conversions.particles import particles_to_message
from node_kit.node import ERROR, OK, WARN, ManagedNode
from node_kit.run import run
from node_kit.tf import TransformBroadcaster
from sphere_geometry import SE3


class MclDepthNode(ManagedNode):
    """Converts, asks the filter, converts back."""

    NAME = "mcl_depth"
    PARAMS = MclDepthParams
    params: MclDepthParams

    def configure(self) -> None:
        """Open topics, services and the cloud."""
        self.geometry: Cloud | TriangleMesh | None = None
        self.filter: Filter | None = None
        if self.params.cloud:
            self.load(self.params.cloud)
        self.pose = self.announce("pose", PoseWithCovarianceStamped)
        self.status = self.announce("status", LocalizationStatus)
        self.particles = self.announce("particle_cloud", ParticleCloud, qos.SENSOR)
        self.heading = self.announce("heading", PoseStamped)
        self.depth = self.announce("synthesized_depth", Image, qos.LARGE)
        self.tf = TransformBroadcaster(self)
        self.intake = Intake(self, self.params, self.on_image)
        self.listen("initialpose", PoseWithCovarianceStamped, self.on_initial_pose, qos.STATE, is_required=False)
        CloudCalls(self)
        self.serve("reinitialize_global_localization", Empty, self.on_reinitialize)

    def clock_jumped(self) -> None:
        """Forget the stream; the pose is searched anew."""
        self.intake.odometry.clear()
        if self.filter is not None:
            self.filter.reset()

    def load(self, path: str) -> None:
        """Use another cloud; ValueError or OSError leaves the present one in force."""
        self.geometry, self.filter = read_map(path), None
        for warning in self.geometry.warnings:
            self.log.warning(warning)

    def on_image(self, message: Image, fault: Finding) -> None:
        """Answer one image."""
        started, stamp = time.perf_counter(), conversions.stamp_ns(message)
        if self.geometry is None:
            self.tell(status_of(State.NO_MAP, stamp, FINE, 0.0, 0.0))
            return
        camera = self.intake.camera
        if fault is not FINE or camera is None:
            known = self.filter.refuse(stamp, fault).status if self.filter is not None else None
            self.tell(known or status_of(State.SEARCHING, stamp, fault, 0.0, 0.0))
            return
        if self.filter is None:
            self.filter = Site(self.geometry, float(self.intake.T_base_sight.translation[2]), self.params).filter()
        grey = conversions.image_to_grey(message)
        look = Look(grey, camera, stamp, self.intake.rotation(), self.intake.T_odom_sight(stamp))
        estimate = self.filter.update(look)
        self.show(estimate, stamp)
        self.publish(estimate, stamp)
        self.tell(replace(estimate.status, milliseconds=(time.perf_counter() - started) * 1e3))

    def publish(self, estimate: Estimate, stamp: int) -> None:
        """Publish the pose of the base and the transform, where the pose is trusted."""
        if estimate.T_map_sight is None or estimate.covariance is None:
            return
        frame, T_sight_base = self.params.map_frame, self.intake.T_base_sight.inverse()
        T_map_sight = SE3.from_parts(estimate.T_map_sight.rotation @ self.intake.tilt, estimate.T_map_sight.translation)
        T_map_base = T_map_sight @ T_sight_base
        covariance = conversions.moved_covariance(estimate.covariance, self.intake.T_base_sight)
        self.pose.publish(conversions.se3_to_pose_with_covariance(T_map_base, covariance, stamp, frame))
        T_odom_base = self.intake.odometry.at(stamp)
        if self.params.publish_tf and T_odom_base is not None:
            self.tf.send(T_map_base @ T_odom_base.inverse(), stamp, frame, self.intake.odom_frame)
        elif self.params.publish_tf and not self.intake.odom_frame:
            self.tf.send(T_map_base, stamp, frame, self.params.base_frame)

    def show(self, estimate: Estimate, stamp: int) -> None:
        """Publish particles, compass and depth image for who looks."""
        belief, frame = estimate.belief, self.params.map_frame
        if belief is None or self.filter is None:
            return
        cloud = belief.particles
        self.particles.publish(particles_to_message(cloud.poses, cloud.weights, stamp, frame))
        pose = np.array([*belief.best.pose[:2], peaks(belief.curve()[None])[0]])
        T_map_heading = pose_of(pose, self.filter.map.height(pose))
        self.heading.publish(conversions.se3_to_pose_stamped(T_map_heading, stamp, frame))
        depth = self.filter.map.depth_at(pose) if self.depth.num_listeners else None
        if depth is not None:
            self.depth.publish(conversions.array_to_image(depth, stamp, frame, "32FC1"))

    def tell(self, status: Status) -> None:
        """Publish a status and report it, with the hit rates of the caches."""
        self.status.publish(conversions.status_to_message(status, status.stamp_ns, self.params.map_frame))
        level = OK if status.state is State.TRACKING else WARN if status.state in TRUSTED else ERROR
        rate = self.filter.map.cache.hit_rate if self.filter is not None else 0.0
        text = f"{status.state} {status.reason}: {status.remedy}" if status.reason else str(status.state)
        self.report("localisation", level, text, quality=status.quality, age=status.age, depth_cache_hits=rate)

    def on_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        """Search around a given pose of the base."""
        T_map_base, covariance = conversions.pose_with_covariance_to_se3(message, self.params.map_frame)
        if self.filter is None:
            raise ValueError("initial pose: expected a cloud and an image before it, found none")
        self.filter.start(T_map_base @ self.intake.T_base_sight, covariance)

    def on_reinitialize(self, request: Empty.Request, response: Empty.Response) -> Empty.Response:
        """Search everywhere."""
        if self.filter is not None:
            self.filter.search()
        return response


def main() -> int:
    """Run the node."""
    return run(MclDepthNode)
