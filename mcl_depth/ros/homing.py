"""Motion directions along a path, published for path_follower (N17 section III-D)."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from sphere_nav_msgs.msg import FollowerStatus

from mcl_depth.belief.estimate import Belief
from mcl_depth.constants import MIN_LEAD
from mcl_depth.homing import Advice, Homing
from mcl_depth.params import MclDepthParams
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import Status
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.conversions.driving import check_frames, guide_status_to_message
from sphere_nav.ros.endpoints import Endpoints


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
