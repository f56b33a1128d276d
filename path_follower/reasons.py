"""Why the vehicle does not drive: a reason, what was measured for it, and what to do about it, in one line."""

from __future__ import annotations

import enum

from path_follower.constants import MIN_POINTS
from sphere_nav.localization.status import Verdict


class StopReason(enum.StrEnum):
    """The words of FollowerStatus."""

    NONE = ""
    OPERATOR = "OPERATOR"
    NOT_LOCALISED = "NOT_LOCALISED"
    LOCALISATION_DEGRADED = "LOCALISATION_DEGRADED"
    POSE_TIMEOUT = "POSE_TIMEOUT"
    POSE_SOURCE = "POSE_SOURCE"
    STATUS_TIMEOUT = "STATUS_TIMEOUT"
    STATUS_SOURCE = "STATUS_SOURCE"
    BAD_POSE = "BAD_POSE"
    POSE_UNCERTAIN = "POSE_UNCERTAIN"
    POSE_JUMP = "POSE_JUMP"
    POSE_FROZEN = "POSE_FROZEN"
    POSE_INCONSISTENT = "POSE_INCONSISTENT"
    NOT_MOVING = "NOT_MOVING"
    WRONG_MAP = "WRONG_MAP"
    OFF_PATH = "OFF_PATH"
    OBSTACLE = "OBSTACLE"
    SCAN_TIMEOUT = "SCAN_TIMEOUT"
    ODOM_TIMEOUT = "ODOM_TIMEOUT"
    CLOCK_STOPPED = "CLOCK_STOPPED"
    COMMAND_SOURCE = "COMMAND_SOURCE"
    COMMAND_GUARD = "COMMAND_GUARD"
    EMERGENCY_STOP = "EMERGENCY_STOP"
    END_OF_PATH = "END_OF_PATH"


REMEDIES = {
    StopReason.NONE: "",
    StopReason.OPERATOR: "call start",
    StopReason.NOT_LOCALISED: "wait for TRACKING or call relocalize of the localiser, then call start",
    StopReason.LOCALISATION_DEGRADED: "wait for TRACKING, then call start",
    StopReason.POSE_TIMEOUT: "check the localiser, the topic of the pose and the clocks, then call start",
    StopReason.POSE_SOURCE: "end all publishers of the pose but one, then call start",
    StopReason.STATUS_TIMEOUT: "check the localiser and the topic of its status, then call start",
    StopReason.STATUS_SOURCE: "end all publishers of the status but one, then call start",
    StopReason.BAD_POSE: "check the frame and the values of the pose, then call start",
    StopReason.POSE_UNCERTAIN: "wait for a pose that is certain, or call relocalize of the localiser, then call start",
    StopReason.POSE_JUMP: "check where the localiser thinks the vehicle is, call relocalize, then call start",
    StopReason.POSE_FROZEN: "check the localiser and its camera, call relocalize, then call start",
    StopReason.POSE_INCONSISTENT: "check the mounting of camera and wheels in the parameters, relocalize, call start",
    StopReason.NOT_MOVING: "check brakes, drive and whoever else limits cmd_vel (or a frozen pose), then call start",
    StopReason.WRONG_MAP: "load the map of the path; after map --extend the frame holds: drop its line '# map_id:'",
    StopReason.OFF_PATH: "bring the vehicle onto the path, heading along it, then call start",
    StopReason.OBSTACLE: "clear the way, then call start",
    StopReason.SCAN_TIMEOUT: "check the scanner and its topic, then call start",
    StopReason.ODOM_TIMEOUT: "check the wheels' odometry and its topic, then call start",
    StopReason.CLOCK_STOPPED: "check who publishes /clock, then call start",
    StopReason.COMMAND_SOURCE: "end all publishers of cmd_vel but one, then call start",
    StopReason.COMMAND_GUARD: "see the log of command_guard, then call start",
    StopReason.EMERGENCY_STOP: "release the emergency stop, then call start",
    StopReason.END_OF_PATH: "load a path or bring the vehicle to its beginning, then call start",
}


class Severity(enum.IntEnum):
    """How bad a reason is: of several the worst is kept, and only an operator ends what is above BLOCKED."""

    NONE = 0
    MISSING = 1  # may end by its return
    BLOCKED = 2  # ends by a new start, also that of a mission whose permission lasts
    WRONG = 3
    OPERATOR = 4
    EMERGENCY = 5


GENTLE = (StopReason.NONE, StopReason.OPERATOR, StopReason.END_OF_PATH)  # the ordinary deceleration is enough
MISSING = (
    *(StopReason.POSE_TIMEOUT, StopReason.STATUS_TIMEOUT, StopReason.SCAN_TIMEOUT, StopReason.ODOM_TIMEOUT),
    StopReason.NOT_LOCALISED,
)
SEVERITY: dict[enum.StrEnum, Severity] = {
    **dict.fromkeys((StopReason.NONE, StopReason.END_OF_PATH), Severity.NONE),
    **dict.fromkeys(MISSING, Severity.MISSING),
    **dict.fromkeys(
        (StopReason.OBSTACLE, StopReason.LOCALISATION_DEGRADED, StopReason.POSE_UNCERTAIN), Severity.BLOCKED
    ),
    StopReason.OPERATOR: Severity.OPERATOR,
    StopReason.EMERGENCY_STOP: Severity.EMERGENCY,
}  # else WRONG


FINE = Verdict(StopReason.NONE)


def describe(verdict: Verdict) -> str:
    """Return everything in one line; empty if all is fine."""
    if verdict.reason is StopReason.NONE:
        return ""
    found = verdict.detail or (f"found {verdict.value:.3g}, limit {verdict.limit:.3g}" if verdict.limit else "")
    return ": ".join(filter(None, (verdict.reason, found, verdict.advise(REMEDIES))))


def over(reason: StopReason, value: float, limit: float, detail: str = "", advice: str = "") -> Verdict:
    """Return a verdict on a value above its limit; else FINE."""
    return Verdict(reason, value, limit, detail, advice) if value > limit else FINE


def blocked(count: int) -> Verdict:
    """Return a verdict on so many points of a scan in the way."""
    return Verdict(StopReason.OBSTACLE, count, MIN_POINTS) if count >= MIN_POINTS else FINE


def first_of(*verdicts: Verdict) -> Verdict:
    """Return the first that is not FINE, if there is one."""
    return next((verdict for verdict in verdicts if verdict is not FINE), FINE)


def severity_of(verdict: Verdict) -> Severity:
    """Return how bad it is."""
    return SEVERITY.get(verdict.reason, Severity.WRONG)
