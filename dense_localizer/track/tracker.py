"""From the last images to the present ones: by the map from what is predicted, else by the last images themselves."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from dense_localizer.judge.acceptance import refusal
from dense_localizer.judge.estimate import Frame
from dense_localizer.judge.place import Place, locate
from dense_localizer.motion_prior import MotionPrior, Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import References
from dense_localizer.track.inter_frame import InterFrame
from dense_localizer.track.visual_odometry import VisualOdometry
from sphere_nav.localization.status import Finding, Reason
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.checks.structure import Aspect

CONTRADICTED = Finding(Reason.JUMP_REJECTED, detail="the map fits elsewhere than the last images say")


class Tracker:
    """Places one instant after the other; `images` are the last ones, placed or not."""

    def __init__(self, references: References, params: LocalizerParams, prior: MotionPrior) -> None:
        self._references, self._params, self._prior = references, params, prior
        self._inter_frame = InterFrame(params.registration)
        self._odometry = VisualOdometry(references, params)
        self._by_images: Place | None = None  # the present ones, by the last ones

    @property
    def images(self) -> tuple[RigImage, ...]:
        """The last images."""
        return self._inter_frame.before

    def forget(self) -> None:
        """Nothing is known of the stream."""
        self._inter_frame.forget()
        self._odometry.forget()
        self._by_images = None

    def remember(self, frame: Frame) -> None:
        """Take note of the images that will be the last ones."""
        self._inter_frame.before = frame.images

    def locate(self, frame: Frame, asked: Aspect) -> tuple[Place, Prediction]:
        """Place images by the map: the likeliest prediction first, others where it fails; refused as by the first.

        `asked` is what their residuals are asked.
        """
        refused: tuple[Place, Prediction] | None = None
        self._by_images = None
        measures = partial(self._inter_frame.refine, frame.images), partial(self._inter_frame.measure, frame.images)
        for prediction in self._prior.predictions(frame.stamp_ns, frame.T_odom_camera, *measures):
            args = self._references, self._params, prediction.T_map_camera, prediction, asked
            place = locate(frame.images, *args, self._odometry.usual_ncc)
            if place.verdict.is_accepted:
                place = self._compare(frame, place, prediction)
                return place, prediction
            refused = refused or (place, prediction)
        assert refused is not None  # there is always a prediction
        return refused

    def _compare(self, frame: Frame, place: Place, prediction: Prediction) -> Place:
        """Return a place by the map; refused where the images since it last fitted contradict."""
        if self._odometry.is_needed:
            self._by_images = self._odometry.propagate(frame.images, prediction, CONTRADICTED)
            if not self._odometry.supports(place, self._by_images):
                return replace(place, verdict=refusal(CONTRADICTED))
        self._odometry.start(place, frame.stamp_ns)
        return place

    def propagate(self, frame: Frame, refused: Place, prediction: Prediction) -> Place | None:
        """Place images that the map has refused by the last ones (M15 section 5.3); None where they do not fit."""
        if self._by_images is not None:
            return self._by_images
        return self._odometry.propagate(frame.images, prediction, refused.verdict.finding)
