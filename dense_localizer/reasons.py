"""What to do about each reason that this localizer gives (docs: status)."""

from __future__ import annotations

from sphere_nav.localization.status import INPUT_REMEDIES, Reason

REMEDIES = INPUT_REMEDIES | {
    Reason.LOW_OVERLAP: "the camera looks at what the map has not seen: turn back, or map this view too",
    Reason.LIGHT_CHANGE: "the light differs from the map's: check exposure limits, or map again in this light",
    Reason.OUTLIERS: "much of the view differs from the map: wait until it is free, or map again",
    Reason.NO_CONVERGENCE: "the alignment did not settle: drive more slowly, or give odometry",
    Reason.JUMP_REJECTED: "the result is too far from the predicted motion: drive more smoothly, or give odometry",
    Reason.AMBIGUOUS: "two places look alike: move on, or give an initial pose",
    Reason.OUTSIDE_REGION: "too far from every key sphere: return to the mapped path, or map here",
    Reason.MAP_ERROR: "the map cannot be read: run sphere_nav map-verify",
    Reason.ODOM_STALE: "odometry is late or contradicts the images: check its source",
}
