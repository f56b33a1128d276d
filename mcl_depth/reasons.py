"""Why the pose is not better than it is: a word of LocalizationStatus.msg, a number, its limit, what to do about it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Reason(StrEnum):
    """The words of LocalizationStatus.msg that this localiser uses; the empty word: nothing is wrong."""

    NONE = ""
    TIMEOUT = "TIMEOUT"
    FROZEN = "FROZEN"
    BAD_STAMP = "BAD_STAMP"
    BAD_INFO = "BAD_INFO"
    TF_STALE = "TF_STALE"
    LOW_TEXTURE = "LOW_TEXTURE"
    OUTLIERS = "OUTLIERS"
    NO_CONVERGENCE = "NO_CONVERGENCE"
    JUMP_REJECTED = "JUMP_REJECTED"
    AMBIGUOUS = "AMBIGUOUS"
    MAP_ERROR = "MAP_ERROR"
    ODOM_STALE = "ODOM_STALE"


REMEDIES = {
    Reason.NONE: "",
    Reason.TIMEOUT: "no image arrives: check that the camera runs, the topic name and its QoS",
    Reason.FROZEN: "the camera repeats one image: restart its driver (a noise-free simulator: input.allow_still)",
    Reason.BAD_STAMP: "stamps must be set and grow: check the camera driver's clock",
    Reason.BAD_INFO: "camera_info does not fit the image: calibrate, or publish the info of this resolution",
    Reason.TF_STALE: "publish the transform from the base to the camera on /tf_static",
    Reason.LOW_TEXTURE: "too little to see: check exposure, lens and light",
    Reason.OUTLIERS: "the image fits this place no better than others: check cloud, camera height and initial pose",
    Reason.NO_CONVERGENCE: "the particles do not agree on one place yet: drive on",
    Reason.JUMP_REJECTED: "odometry leapt and was not believed: check the wheels and who resets odometry",
    Reason.AMBIGUOUS: "two places look alike: drive on until they differ, or give an initial pose",
    Reason.MAP_ERROR: "the cloud cannot be used: see the message of load_cloud",
    Reason.ODOM_STALE: "odometry is missing: check the topic odom and its stamps",
}


@dataclass(frozen=True)
class Finding:
    """A reason with its evidence."""

    reason: Reason
    value: float = 0.0
    limit: float = 0.0
    detail: str = ""

    @property
    def remedy(self) -> str:
        """One line on what to do, led by the detail."""
        advice = REMEDIES[self.reason]
        return f"{self.detail}; {advice}" if self.detail else advice


FINE = Finding(Reason.NONE)
