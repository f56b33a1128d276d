"""Why a frame was not used, or used with care: a word, a number, its limit and what to do about it (docs: status)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Reason(StrEnum):
    """One vocabulary for both localisers, that of LocalizationStatus.msg; the empty word: nothing is wrong."""

    NONE = ""
    GAP = "GAP"
    TIMEOUT = "TIMEOUT"
    FROZEN = "FROZEN"
    BAD_STAMP = "BAD_STAMP"
    BAD_INFO = "BAD_INFO"
    TF_STALE = "TF_STALE"
    LOW_OVERLAP = "LOW_OVERLAP"
    LOW_TEXTURE = "LOW_TEXTURE"
    LIGHT_CHANGE = "LIGHT_CHANGE"
    OUTLIERS = "OUTLIERS"
    NO_CONVERGENCE = "NO_CONVERGENCE"
    JUMP_REJECTED = "JUMP_REJECTED"
    AMBIGUOUS = "AMBIGUOUS"
    OUTSIDE_REGION = "OUTSIDE_REGION"
    MAP_ERROR = "MAP_ERROR"
    ODOM_STALE = "ODOM_STALE"
    OVERRUN = "OVERRUN"


REMEDIES = {
    Reason.NONE: "",
    Reason.GAP: "images are missing: check the camera's rate, its QoS and the load of the computer",
    Reason.TIMEOUT: "no image arrives: check that the camera runs, the topic name and its QoS",
    Reason.FROZEN: "the camera repeats one image: restart its driver (a noise-free simulator: input.allow_still)",
    Reason.BAD_STAMP: "stamps must be set and grow: check the camera driver's clock",
    Reason.BAD_INFO: "camera_info does not fit the image: calibrate, or publish the info of this resolution",
    Reason.TF_STALE: "publish the transform from the base to the camera on /tf_static",
    Reason.LOW_OVERLAP: "the camera looks at what the map has not seen: turn back, or map this view too",
    Reason.LOW_TEXTURE: "too little to see: check exposure, lens and light",
    Reason.LIGHT_CHANGE: "the light differs from the map's: check exposure limits, or map again in this light",
    Reason.OUTLIERS: "much of the view differs from the map: wait until it is free, or map again",
    Reason.NO_CONVERGENCE: "the alignment did not settle: drive more slowly, or give odometry",
    Reason.JUMP_REJECTED: "the result is too far from the predicted motion: drive more smoothly, or give odometry",
    Reason.AMBIGUOUS: "two places look alike: move on, or give an initial pose",
    Reason.OUTSIDE_REGION: "too far from every key sphere: return to the mapped path, or map here",
    Reason.MAP_ERROR: "the map cannot be read: run sphere_nav map-verify",
    Reason.ODOM_STALE: "odometry is late or contradicts the images: check its source",
    Reason.OVERRUN: "images come faster than they are aligned: lower the rate or registration.num_pixels",
}


@dataclass(frozen=True)
class Finding:
    """One fact against a frame; `detail` names the field where the numbers alone do not."""

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
