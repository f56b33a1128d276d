"""What a localiser says about one image, in terms of the vehicle."""

from __future__ import annotations

from dataclasses import dataclass

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.status import Status


@dataclass(frozen=True)
class BaseEstimate:
    """The news of one image; without trust there is no pose.

    covariance (6, 6) is that of xi = (v, omega) in T_map_base @ exp(xi); velocity (6,) is that of the base.
    odometry_covariance (6, 6) is that of the way since it was localised; None: `covariance`.
    """

    status: Status
    T_map_base: SE3 | None = None
    covariance: Array | None = None
    velocity: Array | None = None
    velocity_covariance: Array | None = None
    odometry_covariance: Array | None = None
