"""What the node shows for RViz and Foxglove: particles, compass, hypotheses, similarities, trajectory, depth image."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from sensor_msgs.msg import Image, LaserScan
from sphere_nav_msgs.msg import ParticleCloud
from visualization_msgs.msg import MarkerArray

from mcl_depth.belief.estimate import Belief, level_pose
from mcl_depth.belief.orientation import best_headings
from mcl_depth.filter import Filter
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.conversions.beliefs import hypotheses_to_markers, particles_to_message, similarities_to_scan
from sphere_nav.ros.endpoints import Endpoints


class Views:
    """Publishes what an image made of the belief; what costs time only while someone looks."""

    def __init__(self, endpoints: Endpoints, map_frame: str, base_frame: str) -> None:
        self._frame, self._base_frame = map_frame, base_frame
        self._particles = endpoints.add_publisher("particle_cloud", ParticleCloud, qos.SENSOR)
        self._heading = endpoints.add_publisher("heading", PoseStamped)
        self._hypotheses = endpoints.add_publisher("hypotheses", MarkerArray)
        self._similarity = endpoints.add_publisher("similarity", LaserScan)
        self._trajectory = endpoints.add_publisher("trajectory", Path)
        self._depth = endpoints.add_publisher("synthesized_depth", Image, qos.LARGE)

    def show(self, belief: Belief, filter_: Filter, stamp: int) -> None:
        """Publish everything about one image."""
        cloud, best, curve = belief.particles, belief.best.pose, belief.curve()
        self._particles.publish(particles_to_message(cloud.poses, cloud.weights, stamp, self._frame))
        heading = np.array([*best[:2], best_headings(curve[None])[0]])
        T_map_heading = level_pose(heading, filter_.map.height(best))
        self._heading.publish(conversions.se3_to_pose_stamped(T_map_heading, stamp, self._frame))
        heights = [filter_.map.height(item.pose) for item in belief.hypotheses]
        self._hypotheses.publish(hypotheses_to_markers(belief.hypotheses, heights, stamp, self._frame))
        self._similarity.publish(similarities_to_scan(curve, float(best[2]), stamp, self._base_frame))
        if self._trajectory.num_subscriptions:
            poses = ((at, level_pose(pose, filter_.map.height(pose))) for at, pose in filter_.lineage.trajectory())
            self._trajectory.publish(conversions.poses_to_path(poses, stamp, self._frame))
        depth = filter_.map.depth_at(best) if self._depth.num_subscriptions else None
        if depth is not None:
            self._depth.publish(conversions.array_to_image(depth, stamp, self._frame, "32FC1"))
