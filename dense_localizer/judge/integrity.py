"""What is asked of poses that look right: not of each image, but of all while the pose is not trusted.

Does odometry agree (`odometry_check.py`), what do the residuals look like (`photometric/checks/structure.py`), do the
references agree (`map_error.py`)? What is rejected again and again is counted (`rejections.py`).
"""

from __future__ import annotations

from dense_localizer.judge.estimate import Frame
from dense_localizer.judge.odometry_check import OdometryCheck, Sample
from dense_localizer.judge.place import Place
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import References
from sphere_nav.localization.status import FINE, Finding, Reason, State
from sphere_nav.photometric.checks.structure import EVERYTHING, NOTHING, Aspect, view_residuals

# Each is asked of one image in so many in TRACKING, and no two of the same one: to ask all of one takes as long as to
# align it.
PERIOD = 10
ASKED = {0: Aspect.FIT, 3: Aspect.OCCLUSION, 6: Aspect.ILLUMINATION}
MAP_PHASE = 5  # that image is placed by each reference alone
REJECTION_PHASE = 2  # of that one is counted what the map does not explain


class Doubts:
    """Keeps what earlier images told."""

    def __init__(self, references: References, params: LocalizerParams) -> None:
        self._references, self._error, self._registration = references, references.error, params.registration
        self._odometry = OdometryCheck(params.prior.odometry_error)
        self._is_refused = False  # the image before, which could be used
        self._count, self._is_pulled = 0, False  # pulled: by what was seen when last looked at

    def forget(self) -> None:
        """Another stream, or an operator has said where the camera is; what is known of the map stays."""
        self._odometry.forget()
        self._count, self._is_pulled = 0, False

    def drive(self, frame: Frame, state: State) -> None:
        """Take note of odometry, whatever becomes of the image; `state` is what the image before has led to."""
        if self._is_refused:
            self._error.fade()
        self._is_refused = bool(frame.images)  # until it is placed
        self._odometry.drive(frame.T_odom_camera, is_trusted=state is State.TRACKING)

    def asked(self, state: State) -> Aspect:
        """Return what the residuals of the next image are asked."""
        if state is not State.TRACKING or self._is_pulled:
            return EVERYTHING
        return ASKED.get(self._count % PERIOD, NOTHING)

    def begin(self, frame: Frame, place: Place) -> None:
        """Take note of a place that a search has found."""
        self._is_refused = False
        sample = _sample(frame, place)
        if sample is not None:
            self._odometry.begin(sample)

    def find(self, frame: Frame, place: Place, prediction: Prediction) -> Finding:
        """Return what there is against an image that was placed: by itself, by what preceded it, by odometry."""
        self._count, self._is_pulled, self._is_refused = self._count + 1, place.is_pulled, False
        if self._count % PERIOD == MAP_PHASE and place.alignment is not None and not place.is_pulled:
            self._error.observe(place.images, place.alignment, self._registration, place.motion)
        if self._count % PERIOD == REJECTION_PHASE and place.alignment is not None and place.verdict.is_good:
            residuals = view_residuals(place.images, place.alignment, self._registration, place.motion)
            self._references.count_rejections(place.T_map_camera.translation, residuals)
        sample = _sample(frame, place)
        findings = place.verdict.finding, prediction.finding(), self._odometry.find(sample) if sample else FINE
        return next((finding for finding in findings if finding.reason is not Reason.NONE), FINE)


def _sample(frame: Frame, place: Place) -> Sample | None:
    if frame.T_odom_camera is None:
        return None
    return Sample(frame.stamp_ns, place.T_map_camera, place.covariance, frame.T_odom_camera)
