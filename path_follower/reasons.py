"""Why the vehicle does not drive: a reason, what was measured for it, and what to do about it, in one line."""

from __future__ import annotations

import enum
from typing import Self

from path_follower.constants import MIN_POINTS
from sphere_nav.localization.status import Verdict


class Severity(enum.IntEnum):
    """How bad a reason is: of several the worst is kept, and only an operator ends what is above BLOCKED."""

    NONE = 0
    MISSING = 1  # may end by its return
    BLOCKED = 2  # ends by a new start, also that of a mission whose permission lasts
    WRONG = 3
    OPERATOR = 4
    EMERGENCY = 5


class StopReason(enum.StrEnum):
    """The words of FollowerStatus: each with its meaning, what to do, and how bad it is."""

    meaning: str
    remedy: str
    severity: Severity

    def __new__(cls, word: str, meaning: str = "", remedy: str = "", severity: Severity = Severity.WRONG) -> Self:
        """Make one of its row."""
        one = str.__new__(cls, word)
        one._value_, one.meaning, one.remedy, one.severity = word, meaning, remedy, severity
        return one

    NONE = "", "", "", Severity.NONE
    OPERATOR = "OPERATOR", "a call asked for it", "call start", Severity.OPERATOR
    NOT_LOCALISED = (
        "NOT_LOCALISED",
        "the localiser is neither TRACKING nor DEGRADED",
        "wait for TRACKING or call relocalize of the localiser, then call start",
        Severity.MISSING,
    )
    LOCALISATION_DEGRADED = (
        "LOCALISATION_DEGRADED",
        "the localiser has been DEGRADED for longer than the limit",
        "wait for TRACKING, then call start",
        Severity.BLOCKED,
    )
    POSE_TIMEOUT = (
        "POSE_TIMEOUT",
        "no pose for longer than the limit, or an older one",
        "check the localiser, the topic of the pose and the clocks, then call start",
        Severity.MISSING,
    )
    POSE_SOURCE = (
        "POSE_SOURCE",
        "more than one node publishes the pose",
        "end all publishers of the pose but one, then call start",
    )
    STATUS_TIMEOUT = (
        "STATUS_TIMEOUT",
        "the localiser's status is older than the limit",
        "check the localiser and the topic of its status, then call start",
        Severity.MISSING,
    )
    STATUS_SOURCE = (
        "STATUS_SOURCE",
        "more than one node publishes the status",
        "end all publishers of the status but one, then call start",
    )
    BAD_POSE = (
        "BAD_POSE",
        "pose with a wrong frame, stamp or value",
        "check the frame and the values of the pose, then call start",
    )
    POSE_UNCERTAIN = (
        "POSE_UNCERTAIN",
        "the pose's covariance is larger than the limit, or none at all",
        "wait for a pose that is certain, or call relocalize of the localiser, then call start",
        Severity.BLOCKED,
    )
    POSE_JUMP = (
        "POSE_JUMP",
        "from one pose to the next further than the vehicle can have gone",
        "check where the localiser thinks the vehicle is, call relocalize, then call start",
    )
    POSE_FROZEN = (
        "POSE_FROZEN",
        "the pose stands while the vehicle drives",
        "check the localiser and its camera, call relocalize, then call start",
    )
    POSE_INCONSISTENT = (
        "POSE_INCONSISTENT",
        "the pose moves or turns otherwise than the vehicle",
        "check the mounting of camera and wheels in the parameters, relocalize, call start",
    )
    NOT_MOVING = (
        "NOT_MOVING",
        "the vehicle stands although it is commanded to drive",
        "check brakes, drive and whoever else limits cmd_vel (or a frozen pose), then call start",
    )
    WRONG_MAP = (
        "WRONG_MAP",
        "the path was taught in another map than the localiser's",
        "load the map of the path; after map --extend the frame holds: drop its line '# map_id:'",
    )
    OFF_PATH = (
        "OFF_PATH",
        "further from the path than the limit",
        "bring the vehicle onto the path, heading along it, then call start",
    )
    OBSTACLE = "OBSTACLE", "something in the swept footprint", "clear the way, then call start", Severity.BLOCKED
    SCAN_TIMEOUT = (
        "SCAN_TIMEOUT",
        "obstacle sensing was on and has gone",
        "check the scanner and its topic, then call start",
        Severity.MISSING,
    )
    ODOM_TIMEOUT = (
        "ODOM_TIMEOUT",
        "the wheels' odometry was on and has gone",
        "check the wheels' odometry and its topic, then call start",
        Severity.MISSING,
    )
    CLOCK_STOPPED = (
        "CLOCK_STOPPED",
        "/clock stood still, or went backwards",
        "check who publishes /clock, then call start",
    )
    COMMAND_SOURCE = (
        "COMMAND_SOURCE",
        "another node publishes cmd_vel, too",
        "end all publishers of cmd_vel but one, then call start",
    )
    COMMAND_GUARD = (
        "COMMAND_GUARD",
        "command_guard lets nothing through, or says nothing any more",
        "see the log of command_guard, then call start",
    )
    EMERGENCY_STOP = (
        "EMERGENCY_STOP",
        "pressed, or not to be relied on",
        "release the emergency stop, then call start",
        Severity.EMERGENCY,
    )
    END_OF_PATH = (
        "END_OF_PATH",
        "the end of the path is reached",
        "load a path or bring the vehicle to its beginning, then call start",
        Severity.NONE,
    )


REMEDIES = {reason: reason.remedy for reason in StopReason}


GENTLE = (StopReason.NONE, StopReason.OPERATOR, StopReason.END_OF_PATH)  # the ordinary deceleration is enough
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
    return StopReason(verdict.reason).severity
