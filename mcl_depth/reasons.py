"""What to do about each reason that this localiser gives."""

from __future__ import annotations

from sphere_nav.localization.status import INPUT_REMEDIES, Reason

REMEDIES = INPUT_REMEDIES | {
    Reason.OUTLIERS: "the image fits this place no better than others: check cloud, camera height and initial pose",
    Reason.NO_CONVERGENCE: "the particles do not agree on one place yet: drive on",
    Reason.JUMP_REJECTED: "odometry leapt and was not believed: check the wheels and who resets odometry",
    Reason.AMBIGUOUS: "two places look alike: drive on until they differ, or give an initial pose",
    Reason.MAP_ERROR: "this cloud cannot be used: check its unit and its extent",
    Reason.ODOM_STALE: "odometry is missing: check the topic odom and its stamps",
}
