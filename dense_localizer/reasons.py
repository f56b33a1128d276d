"""What to do about each reason that this localiser gives (docs: status)."""

from __future__ import annotations

import localization.status
from localization.status import Reason

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


class Finding(localization.status.Finding):
    """One fact against an image, with this localiser's advice."""

    ADVICE = REMEDIES


FINE = Finding(Reason.NONE)
