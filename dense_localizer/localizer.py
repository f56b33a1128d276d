"""READ FIRST. One image after the other -> pose of the camera in the map (M15 section 5).

For each image: check it, predict where it was taken, choose references by distance alone (eq. 17), align with two of
them at once (eq. 19), judge the result, update the state. Before the first pose, and after a loss, search instead.
Poses leave this package only in the states TRACKING and DEGRADED. Decisions depend on images and stamps alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dense_localizer.input_check import InputCheck
from dense_localizer.motion_prior import MotionPrior, Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.place import Place, locate
from dense_localizer.reasons import FINE, Finding, Reason
from dense_localizer.reference import References, SphereMap
from dense_localizer.search import Search
from dense_localizer.status import State, StateMachine, Status, status_of
from photometric import Pyramid, build_pyramid, register_rotation
from sphere_geometry import SE3, Camera


@dataclass(frozen=True)
class Frame:
    """One image on its way: its pyramid (None where the image is of no use, `finding` says why) and odometry."""

    stamp_ns: int
    finding: Finding
    pyramid: Pyramid | None
    T_odom_camera: SE3 | None


@dataclass(frozen=True)
class Estimate:
    """The news of one image. Without trust there is no pose; `velocity` (6,) is (v, omega) in the camera frame."""

    status: Status
    T_map_camera: SE3 | None = None
    covariance: NDArray[np.float64] | None = None
    velocity: NDArray[np.float64] | None = None


class Localizer:
    """One camera in one map."""

    def __init__(self, params: LocalizerParams, sphere_map: SphereMap) -> None:
        self.params = params
        self._references = References(sphere_map, params)
        self._input = InputCheck(params.input)
        self._prior = MotionPrior(params.prior)
        self._search = Search(self._references, params)
        self._states = StateMachine(params.state)
        self._before: Pyramid | None = None

    def reset(self) -> None:
        """Forget pose, stream, losses and wishes."""
        self._input.reset()
        self._search.forget()
        self._states.reset()
        self._before = None

    def relocalize(self, T_map_camera: SE3 | None = None) -> None:
        """Search from the next image on, near a pose or everywhere; ValueError for a pose far off the map."""
        self._search.ask(T_map_camera)
        self._states.search()

    def update(self, image: NDArray[Any], camera: Camera, stamp_ns: int, T_odom_camera: SE3 | None = None) -> Estimate:
        """Localise one grey image (H, W); `T_odom_camera` is odometry at its stamp, where there is any."""
        report = self._input.check(image, camera, stamp_ns, self._prior.is_moving)
        if report.finding.reason is Reason.BAD_STAMP:
            return Estimate(self._status(stamp_ns, report.finding))
        if report.is_clock_jump:
            self._search.forget()
            self._states.reset()
        pyramid = build_pyramid(image, camera, self.params.registration.pyramid) if report.is_good else None
        frame = Frame(stamp_ns, report.finding, pyramid, T_odom_camera)
        self._give_up_after_silence(frame)
        estimate = self._follow(frame) if self._states.is_following else self._start(frame)
        self._before = pyramid
        return estimate

    def silence(self, now_ns: int) -> Status | None:
        """Return what to say when no image has come for too long; the state itself follows stamps only."""
        last_ns, limit = self._input.last_stamp_ns, self.params.input.timeout_s
        if last_ns is None or (now_ns - last_ns) * 1e-9 <= limit:
            return None
        state = State.LOST if self._states.is_following else self._states.state
        finding = Finding(Reason.TIMEOUT, (now_ns - last_ns) * 1e-9, limit)
        return status_of(state, now_ns, finding, self._prior.age(now_ns))

    def _follow(self, frame: Frame) -> Estimate:
        """Carry the pose from the last image to this one."""
        if frame.pyramid is None:
            return self._go_blind(frame, frame.finding)
        first = None
        for prediction in self._predictions(frame, frame.pyramid):
            place = locate(frame.pyramid, self._references, prediction.T_map_camera, self.params, prediction)
            if place.verdict.is_accepted:
                return self._accept(frame, place, prediction.step_s)
            first = first or place
        return self._go_blind(frame, first.verdict.finding if first else FINE, first)

    def _predictions(self, frame: Frame, pyramid: Pyramid) -> Iterator[Prediction]:
        """Yield where the camera may be, the most likely first: turned as the images say (eq. 20), or moving on."""
        if self._before is not None and self.params.prior.use_rotation:
            T_before_now = register_rotation(pyramid, self._before, self.params.registration)
            yield self._prior.predict(frame.stamp_ns, frame.T_odom_camera, T_before_now)
        yield self._prior.predict(frame.stamp_ns, frame.T_odom_camera)

    def _accept(self, frame: Frame, place: Place, step_s: float) -> Estimate:
        """Go on from a good alignment."""
        finding, limit = place.verdict.finding, self.params.input.gap_s
        is_good = place.verdict.is_good
        if is_good and step_s > limit:
            finding, is_good = Finding(Reason.GAP, step_s, limit), False
        self._prior.correct(place.T_map_camera, place.covariance, frame.stamp_ns, frame.T_odom_camera)
        self._states.align(is_good, step_s)
        return self._estimate(frame.stamp_ns, finding, place)

    def _go_blind(self, frame: Frame, finding: Finding, place: Place | None = None) -> Estimate:
        """Go on from the prediction, for a while."""
        prediction = self._prior.predict(frame.stamp_ns, frame.T_odom_camera)
        self._prior.hold(prediction, frame.T_odom_camera)
        self._states.refuse(prediction.blind_s, prediction.sigma_m <= self.params.state.max_blind_sigma_m)
        if not self._states.is_following:
            self._search.lost(prediction.T_map_camera)
        return self._estimate(frame.stamp_ns, finding, place)

    def _give_up_after_silence(self, frame: Frame) -> None:
        """Lose the pose when images were missing for too long: nobody knows what happened."""
        prediction = self._prior.last
        if not self._states.is_following or prediction is None:
            return
        if (frame.stamp_ns - prediction.stamp_ns) * 1e-9 > self.params.input.timeout_s:
            self._states.lose()
            self._search.lost(self._prior.predict(frame.stamp_ns, frame.T_odom_camera).T_map_camera)

    def _start(self, frame: Frame) -> Estimate:
        """Look for the pose, if anyone wants to know."""
        if not self._search.is_wanted:
            self._states.withdraw()
            return self._estimate(frame.stamp_ns, frame.finding)
        self._states.search()
        if frame.pyramid is None:
            return self._estimate(frame.stamp_ns, frame.finding)
        found = self._search.find(frame.pyramid, frame.stamp_ns)
        if found.place is not None:
            self._prior.start(found.place.T_map_camera, found.place.covariance, frame.stamp_ns, frame.T_odom_camera)
            self._search.forget()
            self._states.start()
            self._states.align(found.place.verdict.is_good)
        return self._estimate(frame.stamp_ns, found.finding, found.place)

    def _estimate(self, stamp_ns: int, finding: Finding, place: Place | None = None) -> Estimate:
        status = self._status(stamp_ns, finding, place)
        pose = self._prior.last
        if not self._states.is_trusted or pose is None:
            return Estimate(status)
        return Estimate(status, pose.T_map_camera, pose.covariance, self._prior.velocity)

    def _status(self, stamp_ns: int, finding: Finding, place: Place | None = None) -> Status:
        return status_of(self._states.state, stamp_ns, finding, self._prior.age(stamp_ns), place)
