"""What the localizer says about one instant."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dense_localizer.judge.candidate import PoseCandidate
from dense_localizer.judge.lens_watch import LensWatch
from dense_localizer.motion_prior import PosePrior
from dense_localizer.reasons import REMEDIES
from sphere_nav.geometry import SE3
from sphere_nav.localization import Reason, State, StateMachine, Status, Verdict
from sphere_nav.localization.status import BaseEstimate, status_of


@dataclass(frozen=True)
class CameraEstimate:
    """The news of one instant. Without trust there is no pose. The camera is the body of several ones.

    covariance (6, 6) is that of xi in T_map_camera @ exp(xi), relative to the map; odometry_covariance has in it what
    the map has drifted since the camera was localized; velocity (6,) is (v, omega) in the camera frame;
    `candidate` is what it was made from.
    """

    status: Status
    T_map_camera: SE3 | None = None
    covariance: NDArray[np.float64] | None = None
    velocity: NDArray[np.float64] | None = None
    velocity_covariance: NDArray[np.float64] | None = None
    candidate: PoseCandidate | None = None
    odometry_covariance: NDArray[np.float64] | None = None

    def expose_candidate(self) -> CameraEstimate:
        """Return it with the pose of its candidate, trusted or not."""
        if self.candidate is None:
            return self
        return replace(self, T_map_camera=self.candidate.T_map_camera, covariance=self.candidate.covariance)

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


def report_estimate(
    states: StateMachine,
    prior: PosePrior,
    stamp_ns: int,
    finding: Verdict,
    candidate: PoseCandidate | None,
    lens: LensWatch,
) -> CameraEstimate:
    """Return the news of an instant; the pose, as the prior knows it, only where it is trusted.

    What a wrong lens does to it all images share: its covariance is in what is said, not in the prior. A search in
    which nothing resembles the view names the lens, where that is wrong.
    """
    if lens.finding.reason and finding.reason is Reason.LOW_OVERLAP and not states.is_following:
        finding = lens.finding
    status = report_status(states.state, stamp_ns, finding, prior.age(stamp_ns), candidate)
    pose = prior.last
    if pose is None or not states.is_trusted:
        return CameraEstimate(status, candidate=candidate)
    velocity, drift = (prior.velocity, prior.velocity_covariance), prior.drift.covariance
    covariance = pose.covariance + lens.covariance
    return CameraEstimate(status, pose.T_map_camera, covariance, *velocity, candidate, covariance + drift)


def report_status(
    state: State, stamp_ns: int, finding: Verdict, age: float = 0.0, candidate: PoseCandidate | None = None
) -> Status:
    """Return the status with the evidence of a candidate, where there was one."""
    status = status_of(state, stamp_ns, finding, REMEDIES, age=age)
    if candidate is None or candidate.alignment is None:
        return status
    return replace(
        status,
        quality=candidate.acceptance.quality,
        references=candidate.choice.ids,
        overlap=candidate.alignment.overlap,
        inlier_share=candidate.alignment.inlier_share,
        mad=candidate.alignment.mad,
        iterations=candidate.alignment.iterations,
    )
