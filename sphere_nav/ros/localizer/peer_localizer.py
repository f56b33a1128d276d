"""Another localiser of the same vehicle: its poses are compared with ours, and searched around where we have none.

Both localisers publish `pose` in the same map; each hears the other's on `other/pose` (remapped).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped
from numpy.typing import NDArray

from sphere_nav.geometry import SE3
from sphere_nav.geometry.agreement import Agreement, Difference
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.clocks import check_stamp
from sphere_nav.ros.constants import LOG_PERIOD_S, OFFER_PERIOD_NS
from sphere_nav.ros.endpoints import ERROR, OK, Endpoints

OWN, OTHER = 0, 1
REPORT = "agreement"


class PeerLocalizer:
    """Reports every comparison as the diagnostic `agreement`: ERROR beyond both covariances."""

    def __init__(
        self, endpoints: Endpoints, map_frame: str, is_wanted: Callable[[], bool], search: Callable[[SE3, Any], None]
    ) -> None:
        """`search(T_map_base, covariance)` is called while `is_wanted()`; ValueError: the offer cannot be used."""
        self._endpoints, self._frame = endpoints, map_frame
        self._is_wanted, self._search = is_wanted, search
        self._agreement = Agreement()
        self._offered_ns = 0
        endpoints.add_subscription("other/pose", PoseWithCovarianceStamped, self.on_pose, qos.STATE, is_required=False)

    def clear(self) -> None:
        """Forget all poses, as after a jump of the clock."""
        self._agreement.clear()
        self._offered_ns = 0

    def add_own(self, stamp_ns: int, T_map_base: SE3, covariance: NDArray[Any]) -> None:
        """Take note of a pose that we publish."""
        self._tell(self._agreement.add(OWN, stamp_ns, T_map_base, covariance))

    def on_pose(self, message: PoseWithCovarianceStamped) -> None:
        """Compare a pose of the other localiser with ours; search around it where we have none."""
        T_map_base, covariance = conversions.pose_with_covariance_to_se3(message, self._frame)
        stamp = conversions.stamp_ns(message)
        check_stamp(stamp, self._endpoints.now_ns(), "pose of the other localiser")
        self._tell(self._agreement.add(OTHER, stamp, T_map_base, covariance))
        if self._is_wanted() and not 0 <= stamp - self._offered_ns < OFFER_PERIOD_NS:
            self._offered_ns = stamp
            self._search(T_map_base, covariance)

    def _tell(self, found: Difference | None) -> None:
        if found is None:
            return
        level, values = (ERROR if found.is_contradiction else OK), {"metres": found.meters, "radians": found.radians}
        if found.is_contradiction:
            self._endpoints.log.error(f"the other localiser contradicts: {found}", every=LOG_PERIOD_S, key=REPORT)
        self._endpoints.report(REPORT, level, str(found), distance=found.distance, **values)
