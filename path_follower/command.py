"""What comes out of the follower: commands, and what it says about itself."""

from __future__ import annotations

from dataclasses import dataclass

from path_follower.modes import FollowerState
from path_follower.path import Location, ReferencePoint
from path_follower.reasons import REMEDIES
from path_follower.steering import Errors
from sphere_nav.localization.status import Verdict


@dataclass(frozen=True)
class TrackingError:
    """The regulated errors (M15 eq. 22 to 24), the virtual vehicle they refer to, and the place on the path."""

    errors: Errors
    reference: ReferencePoint
    location: Location  # of the pose as measured
    remaining: float  # m from the predicted position to the end of the segment


@dataclass(frozen=True)
class FollowerReport:
    """What the follower does and why; lengths in m."""

    state: FollowerState
    verdict: Verdict
    progress: float
    distance_to_end: float
    is_armed: bool
    permission: int  # the number of the one in force, or of the last

    @property
    def remedy(self) -> str:
        """One line that says what to do."""
        return self.verdict.advise(REMEDIES)


@dataclass(frozen=True)
class Command:
    """Speed of the rear axle m/s, its yaw rate rad/s and the angle of the front wheel rad that belong together."""

    stamp_ns: int
    speed: float
    yaw_rate: float
    steering_angle: float
    tracking: TrackingError | None
    status: FollowerReport
