"""What the node publishes beside its pose: what is to be seen of the belief, and motion directions along a path.

For RViz and Foxglove: particles, compass, hypotheses, depth image. For path_follower: the
direction to the next waypoint (N17 section III-D).
"""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from sensor_msgs.msg import Image
from sphere_nav_msgs.msg import FollowerStatus, ParticleCloud
from visualization_msgs.msg import MarkerArray

from mcl_depth.belief.estimate import Belief, level_pose
from mcl_depth.belief.particles import best_headings
from mcl_depth.constants import MIN_LEAD
from mcl_depth.filter import Filter
from mcl_depth.homing import Advice, Homing
from mcl_depth.params import MclDepthParams
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import Status
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.conversions.beliefs import hypotheses_to_markers, particles_to_message
from sphere_nav.ros.conversions.driving import check_frames, guide_status_to_message
from sphere_nav.ros.endpoints import Endpoints


class Views:
    """Publishes what an image made of the belief; what costs time only while someone looks."""

    def __init__(self, endpoints: Endpoints, map_frame: str) -> None:
        self._frame = map_frame
        self._particles = endpoints.add_publisher("particle_cloud", ParticleCloud, qos.SENSOR)
        self._heading = endpoints.add_publisher("heading", PoseStamped)
        self._hypotheses = endpoints.add_publisher("hypotheses", MarkerArray)
        self._depth = endpoints.add_publisher("synthesized_depth", Image, qos.LARGE)

    def show(self, belief: Belief, filter_: Filter, stamp: int) -> None:
        """Publish everything about one image."""
        cloud, best = belief.particles, belief.best.pose
        self._particles.publish(particles_to_message(cloud.poses, cloud.weights, stamp, self._frame))
        heading = np.array([*best[:2], best_headings(belief.comparison.curves(best[None, :2]))[0]])
        heights = [np.nan_to_num(filter_.map.height(pose)) for pose in (best, *(item.pose for item in belief.places))]
        T_map_heading = level_pose(heading, heights[0])
        self._heading.publish(conversions.se3_to_pose_stamped(T_map_heading, stamp, self._frame))
        self._hypotheses.publish(hypotheses_to_markers(belief.places, heights[1:], stamp, self._frame))
        depth = filter_.map.ranges_from(best) if self._depth.num_subscriptions else None
        if depth is not None:
            self._depth.publish(conversions.array_to_image(depth, stamp, self._frame, "32FC1"))


class HomingGuide:
    """Listens for a path; says for every image where its next waypoint lies, and whether that can be trusted."""

    def __init__(self, endpoints: Endpoints, params: MclDepthParams) -> None:
        self._frame, self._base_frame, self._params = params.map_frame, params.base_frame, params.homing
        self.homing: Homing | None = None
        self._advice: Advice | None = None
        self._direction = endpoints.add_publisher("homing/direction", PoseStamped)
        self._status = endpoints.add_publisher("homing/status", FollowerStatus)
        endpoints.add_subscription("reference_path", Path, self.on_path, qos.LATCHED, is_required=False, silence=0.0)

    def on_path(self, message: Path) -> None:
        """Take a path in the map; the vehicle is near its beginning. The same path again changes nothing."""
        check_frames(message, self._frame)
        points = np.array([T_map_base.translation[:2] for _, T_map_base in conversions.path_to_poses(message)])
        homing = Homing(points.reshape(-1, 2), self._params)
        if self.homing is None or not np.array_equal(homing.waypoints, self.homing.waypoints):
            self.homing, self._advice = homing, None

    def answer(self, belief: Belief | None, status: Status, stamp: int) -> None:
        """Say what one image tells; an image like the last one (no belief, nothing wrong) tells the same."""
        if self.homing is None:
            return
        if belief is not None:
            self._advice = self.homing.update(belief.comparison)
        elif status.reason:
            self._advice = None
        if self._advice is not None and self._advice.is_clear:
            direction = SE3.from_planar(0.0, 0.0, self._advice.in_vehicle)
            message = conversions.se3_to_pose_stamped(direction, stamp, self._base_frame)
            self._direction.publish(message)
        way = self.homing.gone, self.homing.left
        self._status.publish(guide_status_to_message(self._advice, way, MIN_LEAD, stamp, self._frame))
