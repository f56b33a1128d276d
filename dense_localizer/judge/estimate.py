"""What goes into the localiser for one image, and what comes out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dense_localizer.judge.place import Place
from dense_localizer.motion_prior import MotionPrior
from dense_localizer.reasons import REMEDIES
from sphere_nav.geometry import SE3
from sphere_nav.localization import status as localization_status
from sphere_nav.localization.base_estimate import BaseEstimate
from sphere_nav.localization.status import Finding, State, Status
from sphere_nav.photometric.align.rig import RigImage


@dataclass(frozen=True)
class Frame:
    """The images of an instant on their way (none where all are of no use, `finding` says why) and odometry."""

    stamp_ns: int
    finding: Finding
    images: tuple[RigImage, ...]
    T_odom_camera: SE3 | None


@dataclass(frozen=True)
class Estimate:
    """The news of one instant. Without trust there is no pose. The camera is the body of several ones.

    covariance (6, 6) is that of xi in T_map_camera @ exp(xi), relative to the map; odometry_covariance has in it what
    the map has drifted since the camera was localised; velocity (6,) is (v, omega) in the camera frame;
    `place` is the attempt behind it, for whoever wants to look.
    """

    status: Status
    T_map_camera: SE3 | None = None
    covariance: NDArray[np.float64] | None = None
    velocity: NDArray[np.float64] | None = None
    velocity_covariance: NDArray[np.float64] | None = None
    place: Place | None = None
    odometry_covariance: NDArray[np.float64] | None = None

    def at_place(self) -> Estimate:
        """Return it with the pose of the attempt behind it, trusted or not."""
        if self.place is None:
            return self
        return replace(self, T_map_camera=self.place.T_map_camera, covariance=self.place.covariance)

    def to_base(self, T_base_camera: SE3) -> BaseEstimate:
        """Return what it says about the base."""
        if self.T_map_camera is None or self.covariance is None:
            return BaseEstimate(self.status)
        Ad = T_base_camera.adjoint()
        pose = self.status, self.T_map_camera @ T_base_camera.inverse(), Ad @ self.covariance @ Ad.T
        way = Ad @ self.odometry_covariance @ Ad.T if self.odometry_covariance is not None else None
        if self.velocity is None or self.velocity_covariance is None:
            return BaseEstimate(*pose, odometry_covariance=way)
        return BaseEstimate(*pose, Ad @ self.velocity, Ad @ self.velocity_covariance @ Ad.T, way)


def estimate_of(status: Status, prior: MotionPrior, place: Place | None, *, is_trusted: bool) -> Estimate:
    """Return the news of an instant; the pose, as the prior knows it, only where it is trusted."""
    pose = prior.last
    if pose is None or not is_trusted:
        return Estimate(status, place=place)
    velocity = prior.velocity, prior.velocity_covariance
    return Estimate(
        status, pose.T_map_camera, pose.covariance, *velocity, place, pose.covariance + prior.drift.covariance
    )


def status_of(state: State, stamp_ns: int, finding: Finding, age: float = 0.0, place: Place | None = None) -> Status:
    """Return the status with the evidence of an attempt to place the image, where there was one."""
    status = localization_status.status_of(state, stamp_ns, finding, REMEDIES, age=age)
    if place is None or place.alignment is None:
        return status
    return replace(
        status,
        quality=place.verdict.quality,
        references=place.choice.ids,
        overlap=place.alignment.overlap,
        inlier_share=place.alignment.inlier_share,
        mad=place.alignment.mad,
        iterations=place.alignment.iterations,
    )
