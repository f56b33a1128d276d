"""READ FIRST. One image after the other -> pose of the camera in the map (M15 section 5).

For each instant: check the images, predict where they were taken, choose references by distance alone (eq. 17), align
with two at once (eq. 19), judge the result, update the state; before the first pose and after a loss, search. Poses
leave this package only in TRACKING and DEGRADED. Decisions depend on images and stamps alone. Cameras may be several.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray

from dense_localizer.inputs import CameraImage, Inputs
from dense_localizer.judge.estimate import Estimate, Frame, estimate_of, status_of
from dense_localizer.judge.integrity import Doubts
from dense_localizer.judge.place import Place
from dense_localizer.motion_prior import MotionPrior, Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import References, SphereMap
from dense_localizer.start.search import Search
from dense_localizer.track.tracker import Tracker
from sphere_nav.geometry import SE3, Camera
from sphere_nav.localization import FINE, Finding, Reason, StateMachine, Status


class Localizer:
    """One camera, or several of one body, in one map; live ones never wait for a key sphere, else runs are equal."""

    def __init__(self, params: LocalizerParams, sphere_map: SphereMap, *, is_live: bool = False) -> None:
        self.params, self.references = params, References(sphere_map, params, is_live=is_live)
        self._inputs, self._prior = Inputs(params), MotionPrior(params.prior, sphere_map.graph)
        self._tracker = Tracker(self.references, params, self._prior)
        self._search = Search(self.references, params)
        self._states, self._doubts = StateMachine(params.state), Doubts(self.references, params)

    def reset(self) -> None:
        """Forget pose, stream, losses and wishes."""
        self._inputs.reset()
        self._forget()

    def relocalize(self, T_map_camera: SE3 | None = None) -> Estimate | None:
        """Search with the last image and those to come, near a pose or everywhere; ValueError for one off the map."""
        self._search.ask(T_map_camera)
        self._doubts.forget()
        self._states.search()
        stamp_ns, images = self._inputs.stream.last_stamp_ns, self._tracker.images
        return self._start(Frame(stamp_ns, FINE, images, None)) if stamp_ns and images else None

    def refuse(self, stamp_ns: int, finding: Finding) -> Estimate:
        """Take note of an image that cannot even be read; a stamp that is none moves nothing."""
        if finding.reason is Reason.BAD_STAMP:
            return Estimate(self._status(stamp_ns, finding))
        return self._step(Frame(stamp_ns, finding, (), None))

    def update(self, image: NDArray[Any], camera: Camera, stamp_ns: int, T_odom_camera: SE3 | None = None) -> Estimate:
        """Localise one grey image (H, W); `T_odom_camera` is odometry at its stamp, where there is any."""
        return self.update_rig((CameraImage(image, camera),), stamp_ns, T_odom_camera)

    def update_rig(self, images: Sequence[CameraImage], stamp_ns: int, T_odom_body: SE3 | None = None) -> Estimate:
        """Localise the images of one instant; odometry and all poses are those of their body."""
        report = self._inputs.check(images, stamp_ns, self._prior)
        if report.finding.reason is Reason.BAD_STAMP:
            return self.refuse(stamp_ns, report.finding)
        if report.is_clock_jump:
            self._forget()
        return self._step(Frame(stamp_ns, report.finding, report.images, T_odom_body))

    def silence(self, elapsed_s: float, finding: Finding = FINE) -> Status | None:
        """Return what to say so long after the last usable image, if that is too long; the state follows stamps."""
        silence = self._inputs.stream.find_silence(elapsed_s, finding)
        return silence and status_of(self._states.after_silence, *silence, self._prior.age(silence[0]))

    def _forget(self) -> None:
        self._prior.reset()
        self._search.forget()
        self._doubts.forget()
        self._states.reset()
        self._tracker.forget()

    def _step(self, frame: Frame) -> Estimate:
        self._doubts.drive(frame, self._states.state)
        if self._states.is_following and self._prior.pause_s(frame.stamp_ns) > self.params.input.timeout_s:
            self._states.lose()  # nobody knows what happened meanwhile
            self._search.lost(self._prior.predict(frame.stamp_ns, frame.T_odom_camera).T_map_camera)
        estimate = self._follow(frame) if self._states.is_following else self._start(frame)
        self._tracker.remember(frame)
        return estimate

    def _follow(self, frame: Frame) -> Estimate:
        """Carry the pose from the last image to this one."""
        if not frame.images:
            return self._go_blind(frame, frame.finding)
        place, prediction = self._tracker.locate(frame, self._doubts.asked(self._states.state))
        go_on = self._accept if place.verdict.is_accepted else self._propagate
        return go_on(frame, place, prediction)

    def _accept(self, frame: Frame, place: Place, prediction: Prediction) -> Estimate:
        """Go on from a good alignment; good as it is, what preceded it may ask for care."""
        finding = self._doubts.find(frame, place, prediction)
        self._prior.correct(place.T_map_camera, place.covariance, frame.stamp_ns, frame.T_odom_camera, place.noise)
        self.references.look_ahead(place.T_map_camera, self._prior.velocity, is_rig=place.is_rig)
        self._states.confirm(frame.stamp_ns, is_good=finding.reason is Reason.NONE)
        return self._estimate(frame.stamp_ns, finding if finding.reason else frame.finding, place)

    def _propagate(self, frame: Frame, refused: Place, prediction: Prediction) -> Estimate:
        """Go on by the last image where the map does not fit (M15 section 5.3), else from the prediction."""
        place = self._tracker.propagate(frame, refused, prediction) if self._states.is_trusted else None
        if place is None:
            return self._go_blind(frame, refused.verdict.finding, refused)
        pose = place.T_map_camera, place.covariance, frame.stamp_ns, frame.T_odom_camera, place.noise
        self._prior.correct(*pose, is_by_map=False)
        self._states.refuse(is_lost=not place.is_certain)
        return self._estimate(frame.stamp_ns, place.verdict.finding, place)

    def _go_blind(self, frame: Frame, finding: Finding, place: Place | None = None) -> Estimate:
        """Go on from the prediction, for a while."""
        prediction = self._prior.predict(frame.stamp_ns, frame.T_odom_camera)
        self._prior.hold(prediction, frame.T_odom_camera)
        is_blind = prediction.blind_s > self.params.state.max_blind_s
        self._states.refuse(is_lost=is_blind or not prediction.is_certain)
        if not self._states.is_following:
            self._search.lost(prediction.T_map_camera)
        return self._estimate(frame.stamp_ns, finding, place)

    def _start(self, frame: Frame) -> Estimate:
        """Look for the pose, if anyone wants to know."""
        if not self._search.is_wanted:
            self._states.withdraw()
            return self._estimate(frame.stamp_ns, frame.finding)
        self._states.search()
        if not frame.images:
            return self._estimate(frame.stamp_ns, frame.finding)
        found = self._search.find(frame.images, frame.stamp_ns)
        if found.place is not None:
            self._prior.start(found.place.T_map_camera, found.place.covariance, frame.stamp_ns, frame.T_odom_camera)
            self.references.look_ahead(found.place.T_map_camera, None, is_rig=found.place.is_rig)
            self._search.forget()
            self._doubts.begin(frame, found.place)
            self._states.start()
            self._states.confirm(frame.stamp_ns, is_good=found.place.verdict.is_good)
        return self._estimate(frame.stamp_ns, found.finding, found.place)

    def _estimate(self, stamp_ns: int, finding: Finding, place: Place | None = None) -> Estimate:
        status = self._status(stamp_ns, finding, place)
        return estimate_of(status, self._prior, place, is_trusted=self._states.is_trusted)

    def _status(self, stamp_ns: int, finding: Finding, place: Place | None = None) -> Status:
        return status_of(self._states.state, stamp_ns, finding, self._prior.age(stamp_ns), place)
