"""READ FIRST. One image after the other -> pose of the camera in the map (M15 section 5).

For each instant: check the images, predict where they were taken, choose references (eq. 17), align with two at once
(eq. 19), assess, ask another day's and depth where that does not do, update the state; before the first pose and after
a loss, search. Poses leave this package only in TRACKING and DEGRADED. Decisions depend on images and stamps alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from numpy.typing import NDArray

from dense_localizer.inputs import CameraImage, Inputs, LocalizerInput
from dense_localizer.judge.candidate import PoseCandidate
from dense_localizer.judge.estimate import CameraEstimate, report_estimate, report_status
from dense_localizer.judge.integrity import Integrity, align_rig, find_candidate
from dense_localizer.motion_prior import InterFrame, PosePrior, Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.coarse_reference import Tried
from dense_localizer.references.reference import References, SphereMap
from dense_localizer.start.search import PoseSearch
from dense_localizer.track.range_support import RangeSupport
from dense_localizer.track.visual_odometry import VisualOdometry
from sphere_nav.geometry import SE3, Camera
from sphere_nav.localization import FINE, Reason, StateMachine, Status, Verdict


class Localizer:
    """One camera, or several of one body, in one map; live ones never wait for a key sphere, else runs are equal."""

    def __init__(self, params: LocalizerParams, sphere_map: SphereMap, *, is_live: bool = False) -> None:
        self.params, self._inter_frame = params, InterFrame(params.registration)
        self._prior = PosePrior(params.prior, sphere_map.graph, self._inter_frame)
        self.references = References(sphere_map, params, is_live=is_live)
        self._inputs = Inputs(params, self.references.pixels_per_radian)
        self._integrity, self._range_support = Integrity(self.references, params), RangeSupport(self.references, params)
        self._visual_odometry = VisualOdometry(self.references, params)
        self.search, self._states = PoseSearch(self.references, params), StateMachine(params.state)

    def update(self, image: NDArray[Any], camera: Camera, stamp_ns: int, T_odom: SE3 | None = None) -> CameraEstimate:
        """Localize one grey image (H, W); `T_odom` (camera) is odometry at its stamp, where there is any."""
        return self.update_rig((CameraImage(image, camera),), stamp_ns, T_odom)

    def update_rig(self, images: Sequence[CameraImage], stamp_ns: int, T_odom: SE3 | None = None) -> CameraEstimate:
        """Localize the images of one instant; odometry and all poses are those of their body."""
        return self._step(self._inputs.check(images, stamp_ns, T_odom, self._prior.velocity))

    def refuse(self, stamp_ns: int, finding: Verdict) -> CameraEstimate:
        """Note an image that cannot even be read."""
        return self._step(LocalizerInput(stamp_ns, finding))

    def _step(self, frame: LocalizerInput) -> CameraEstimate:
        """Track or search; a stamp that is none moves nothing."""
        if frame.finding.reason is Reason.BAD_STAMP:
            return CameraEstimate(self._report(frame, frame.finding).status)
        if frame.is_clock_jump:
            self._forget()
        self._integrity.begin(frame, self._states.state)
        if self._states.is_following and self._prior.pause_s(frame.stamp_ns) > self.params.input.timeout_s:
            self._states.lose()  # nobody knows what happened meanwhile
            self.search.start_near(self._prior.predict(frame.stamp_ns, frame.T_odom_camera).T_map_camera, frame)
        estimate = self._track(frame) if self._states.is_following else self._find_start(frame)
        self._inter_frame.images = frame.images
        return estimate

    def _track(self, frame: LocalizerInput) -> CameraEstimate:
        """Go on by the map, by the last images where it does not fit (M15 section 5.3), else by the prediction."""
        if not (frame.images or frame.depth):
            return self._hold(frame, frame.finding)
        verify = partial(self._visual_odometry.verify, frame, is_trusted=self._states.is_trusted)
        candidate = find_candidate(self._prior.propose(frame), partial(self._locate, frame), verify, self.references)
        if not candidate.is_accepted:
            return self._hold(frame, candidate.finding if frame.images else frame.finding, candidate)
        return self._update(frame, candidate)

    def _locate(self, frame: LocalizerInput, prediction: Prediction, tried: Tried = ()) -> PoseCandidate:
        """Choose references, align, assess, ask depth: of a prediction, or of a guess of the search."""
        prediction = replace(self.references.ground.stand(prediction), is_trusted=self._states.is_trusted)
        chosen = self._integrity.mask.hide(self.references.choose_rig(frame.images, prediction, instead_of=tried))
        alignment = align_rig(chosen, prediction, self.params)
        evidence = self._states.state, self._visual_odometry.usual_ncc(chosen.choice.by_contrast)
        candidate = self._integrity.assess(chosen, alignment, prediction, *evidence)
        return candidate if frame.depth is None else self._range_support.support(frame.depth, candidate)

    def _update(self, frame: LocalizerInput, candidate: PoseCandidate) -> CameraEstimate:
        """Go on from a candidate and its prediction; by the map and good, what preceded it may ask for care."""
        placed = candidate.join()
        pose = placed.T_map_camera, placed.covariance, frame.stamp_ns, frame.T_odom_camera, placed.noise
        self._prior.correct(*pose, is_by_map=placed.is_by_map)
        if not candidate.is_by_map:
            self._states.refuse(is_lost=not candidate.is_certain)
            return self._report(frame, candidate.finding, candidate)
        self._visual_odometry.start(placed, frame.stamp_ns)
        finding = self._integrity.confirm(frame, candidate, placed, self._states.state)
        self.references.prefetch(candidate.T_map_camera, self._prior.velocity, is_rig=candidate.is_rig)
        self._states.confirm(frame.stamp_ns, is_good=finding.reason is Reason.NONE, num_images=candidate.num_images)
        return self._report(frame, finding if finding.reason else frame.finding, candidate)

    def _hold(self, frame: LocalizerInput, finding: Verdict, refused: PoseCandidate | None = None) -> CameraEstimate:
        """Go on from the prediction, for a while."""
        prediction = self._prior.predict(frame.stamp_ns, frame.T_odom_camera)
        self._prior.hold(prediction, frame.T_odom_camera, is_refused=refused is not None)
        is_blind = prediction.blind_s > self.params.state.max_blind_s
        self._states.refuse(is_lost=is_blind or not prediction.is_certain)
        if not self._states.is_following:
            self.search.start_near(prediction.T_map_camera, frame)
        return self._report(frame, finding, refused)

    def _find_start(self, frame: LocalizerInput) -> CameraEstimate:
        """Search for the pose, if anyone wants it: locate by guesses, start from the one that is clearly the best."""
        (self._states.search if self.search.is_wanted else self._states.withdraw)()
        candidate, finding = self.search.find(frame, self._locate)
        if candidate is not None:
            self._prior.start(candidate.T_map_camera, candidate.covariance, frame.stamp_ns, frame.T_odom_camera)
            self.references.prefetch(candidate.T_map_camera, None, is_rig=candidate.is_rig)
            self.search.reset()
            self._states.start(is_found_again=self._integrity.start(frame, candidate))
            self._states.confirm(frame.stamp_ns, is_good=candidate.acceptance.is_good, num_images=candidate.num_images)
        return self._report(frame, finding, candidate)

    def relocalize(self, T_map_camera: SE3 | None = None) -> CameraEstimate | None:
        """Search with the last image and those to come, near a pose or everywhere; ValueError for one off the map."""
        self.search.request(T_map_camera)
        self._integrity.reset()
        self._states.search()
        stamp_ns, images = self._inputs.stream.last_stamp_ns, self._inter_frame.images
        return self._find_start(LocalizerInput(stamp_ns, FINE, images)) if stamp_ns and images else None

    def silence(self, elapsed_s: float, finding: Verdict = FINE) -> Status | None:
        """Return what to say so long after the last usable image, if that is too long; the state follows stamps."""
        found = self._inputs.stream.find_silence(elapsed_s, finding)
        return found and report_status(self._states.after_silence, *found, self._prior.age(found[0]))

    def reset(self) -> None:
        """Forget pose, stream, losses and requests."""
        self._inputs.reset()
        self._forget()

    def _forget(self) -> None:
        for one in (self._prior, self.search, self._integrity, self._states, self._inter_frame, self._visual_odometry):
            one.reset()

    def _report(self, frame: LocalizerInput, finding: Verdict, used: PoseCandidate | None = None) -> CameraEstimate:
        return report_estimate(self._states, self._prior, frame.stamp_ns, finding, used, self._integrity.lens)
