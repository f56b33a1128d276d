"""What to do about each reason that this localiser gives."""

from __future__ import annotations

import localization.status
from localization.status import Reason

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
    Reason.MAP_ERROR: "this cloud cannot be used: check its unit and its extent",
    Reason.ODOM_STALE: "odometry is missing: check the topic odom and its stamps",
}


class Finding(localization.status.Finding):
    """One fact against an image, with this localiser's advice."""

    ADVICE = REMEDIES


FINE = Finding(Reason.NONE)
