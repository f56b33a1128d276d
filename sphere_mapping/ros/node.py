"""The node `sphere_mapper`: spheres, RGB-D or stereo images in; the graph of key spheres and the vehicle's pose out."""

from __future__ import annotations

import numpy as np
from nav_msgs.msg import Odometry, Path
from sensor_msgs.msg import PointCloud2
from sphere_nav_msgs.msg import KeySphereGraph
from sphere_nav_msgs.srv import SaveMap
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from sphere_mapping.acquisition.warm_up import warm_up as warm_up_acquisition
from sphere_mapping.graph.tracking import Unroll
from sphere_mapping.map_cloud import MapCloud
from sphere_mapping.mapper import Mapper, MapUpdate
from sphere_mapping.params import SphereMapperParams
from sphere_mapping.ros.intake import Intake, with_driver_input
from sphere_mapping.ros.mount import CameraMount, VehicleFrame
from sphere_mapping.ros.saving import Journal, save
from sphere_nav.geometry import SE3
from sphere_nav.photometric.warm_up import warm_up
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.camera.odometry_input import OdometryInput
from sphere_nav.ros.conversions.graphs import graph_to_markers
from sphere_nav.ros.localizer.pose_outputs import MapTransform
from sphere_nav.ros.node import OK, WARN, ManagedNode
from sphere_nav.ros.run import run
from sphere_nav.ros.tf import TransformListener
from sphere_nav.spheres.sphere import Sphere

PATH_STEP = 10  # every how many spheres the path is told


class SphereMapper(ManagedNode):
    """Converts, asks the mapper, converts back."""

    NAME = "sphere_mapper"
    PARAMS = SphereMapperParams
    LARGE_MESSAGES = True
    params: SphereMapperParams

    def configure(self) -> None:
        """Compile the kernels, open topics and services."""
        warm_up()
        warm_up_acquisition()
        self.params = with_driver_input(self.params)
        self.journal = Journal(self.params, self.log.info) if self.endpoints.is_live else None
        self.mapper = Mapper(self.params.mapper, store=self.journal)
        self.points = MapCloud(self.params.cloud, lambda sphere_id: self.mapper.load_sphere(sphere_id))
        self.num_lost, self.num_changes, self.mount = 0, 0, CameraMount("", False, SE3.identity())
        self.graph = self.add_publisher("graph", KeySphereGraph, qos.LATCHED)
        self.markers = self.add_publisher("graph/markers", MarkerArray, qos.LATCHED)
        self.cloud = self.add_publisher("map_cloud", PointCloud2, qos.LATCHED)
        self.odometry, self.path = self.add_publisher("odometry", Odometry), self.add_publisher("path", Path)
        map_frame, base_frame = self.params.map_frame, self.params.base_frame
        self.tf = TransformListener(self.endpoints, ignored=map_frame)
        self.odom = OdometryInput(self.endpoints, self.tf, base_frame)
        self.transform = MapTransform(self.endpoints, self.odom, map_frame, base_frame)
        self.vehicle = VehicleFrame(self.endpoints, self.params, self.tf, is_live=self.endpoints.is_live)
        self.intake = Intake(self.params, self.on_sphere, self.tf.lookup, self.report, find_mount=self.vehicle.find)
        self.intake.subscribe(self.endpoints)
        self.add_service("~/close_loops", Trigger, self.on_close_loops)
        self.add_service("~/save_map", SaveMap, self.on_save)
        self.report("mapping", OK, "waiting for the first sphere")

    def cleanup(self) -> None:
        """End the journal."""
        if self.journal is not None:
            self.journal.close(self.mapper)

    def clock_jumped(self) -> None:
        """Forget what has a stamp; the map stays."""
        self.intake.clear()
        self.odom.clear()
        self.transform.clear()

    @property
    def T_base_sphere(self) -> SE3:
        """The latest sphere on the vehicle."""
        return self.mount.T_base_sphere

    def on_sphere(self, sphere: Sphere, mount: CameraMount, unroll: Unroll | None = None) -> None:
        """Map a sphere, tell what changed."""
        self.mount = mount
        if not self.mapper.tracks and not self.begin_map(sphere):
            return
        T_odom_base = self.odom.predict(sphere.stamp_ns)
        update = self.mapper.add(sphere, T_odom_base and T_odom_base @ self.T_base_sphere, unroll)
        if update.T_map_sphere is None:
            self.num_lost += 1
            reason = update.alignment.reason if update.alignment else ""
            self.report("mapping", WARN, f"sphere not placed: {reason}", key_spheres=len(self.mapper.graph))
            self.log.warning(f"sphere at {sphere.stamp_ns / 1e9:.3f} s not placed: {reason}", every=1.0, key=reason)
            return
        self.publish_pose(update, update.T_map_sphere)
        if update.is_key:
            self.log.info(f"key sphere {len(self.mapper.graph) - 1}: {update.key_reason}")
            self.publish_map(sphere.stamp_ns)

    def begin_map(self, sphere: Sphere) -> bool:
        """Put the vehicle at the origin of the map, level; return whether all is known that this needs."""
        if self.vehicle.waits(sphere.stamp_ns):
            return False
        T_map_base, source = self.vehicle.begin(sphere, self.mount)
        self.mapper.T_map_first = T_map_base @ self.T_base_sphere
        self.mapper.origin = f"{self.params.base_frame} at the first sphere, level by {source}"
        self.mapper.T_base_sphere = self.T_base_sphere if np.any(self.T_base_sphere.translation) else None
        if self.journal is not None:
            self.journal.frame = self.mapper.origin, self.mapper.T_base_sphere
        self.log.info(f"{self.params.map_frame}: {self.mapper.origin}")
        return True

    def publish_pose(self, update: MapUpdate, T_map_sphere: SE3) -> None:
        """Publish where the vehicle is, with the stamp of the sphere."""
        p, stamp, found = self.params, update.stamp_ns, update.alignment
        T_map_base = T_map_sphere @ self.T_base_sphere.inverse()
        covariance = conversions.move_covariance(found.covariance if found else np.zeros((6, 6)), self.T_base_sphere)
        self.odometry.publish(conversions.se3_to_odometry(T_map_base, covariance, stamp, (p.map_frame, p.base_frame)))
        self.transform.update(T_map_base, stamp)
        number, T_sphere_base = len(self.mapper.tracks), self.T_base_sphere.inverse()
        if number % PATH_STEP == 1 or update.is_key:
            poses = ((ns, T_map_track @ T_sphere_base) for ns, T_map_track in self.mapper.trajectory())
            self.path.publish(conversions.poses_to_path(poses, stamp, p.map_frame))
        values = {"spheres": number, "key_spheres": len(self.mapper.graph), "mad": found.mad if found else 0.0}
        self.report("mapping", OK, "mapping", **values)

    def publish_map(self, stamp: int) -> None:
        """Publish the graph, and what is to be looked at only where someone looks."""
        graph, frame = self.mapper.graph, self.params.map_frame
        self.num_changes += 1
        self.graph.publish(conversions.graph_to_message(graph, frame, version=self.num_changes))
        if self.markers.num_subscriptions:
            self.markers.publish(graph_to_markers(graph, stamp, frame))
        if self.cloud.num_subscriptions:
            points, gray = self.points.of(graph)
            self.cloud.publish(conversions.cloud_to_message(points, stamp, frame, gray))

    def on_save(self, request: SaveMap.Request, response: SaveMap.Response) -> SaveMap.Response:
        """Write the map."""
        return save(self.mapper, self.params, request, response, self.journal)

    def on_close_loops(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Correct the map by the places seen twice."""
        number = self.mapper.close_loops()
        response.success, response.message = True, f"{number} loops closed"
        if number:
            self.publish_map(self.mapper.tracks[-1].stamp_ns)
        return response


def main() -> int:
    """Run the node."""
    return run(SphereMapper)
