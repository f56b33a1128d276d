"""Images aligned to the references chosen for a prediction (M15 eq. 19), from the coarsest level that this needs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dense_localizer.constants import CONTRAST_COVARIANCE
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import Choice, RigChoice
from sphere_nav.photometric import Alignment, Pyramid
from sphere_nav.photometric.align.esm import register_rig
from sphere_nav.photometric.params import between


def align_rig(chosen: RigChoice, prediction: Prediction, params: LocalizerParams) -> Alignment | None:
    """Return the alignment of the images that references cover, all at once; None where they cover none."""
    images, registration = chosen.covered, params.registration
    if not images:
        return None
    if not (prediction.is_guess or prediction.defies_odometry):
        first = find_first_level(prediction, chosen.choice, images[0].pyramid)
        registration = between(registration, coarsest=min(first, registration.pyramid.coarsest))
    motion = prediction.frame_motion(params.camera.readout)
    found = register_rig(images, prediction.T_map_camera, registration, motion, prediction.expected)
    return replace(found, covariance=CONTRAST_COVARIANCE * found.covariance) if chosen.choice.by_contrast else found


def find_first_level(prediction: Prediction, choice: Choice, pyramid: Pyramid) -> int:
    """Return the coarsest level needed: the one at which the uncertainty of the prediction is about a pixel."""
    deviation = np.sqrt(np.diagonal(prediction.covariance))
    angle = np.max(deviation[3:]) + np.max(deviation[:3]) / choice.typical_range_m
    pixels = angle * pyramid.levels[0].camera.pixels_per_radian
    return max(0, int(np.ceil(np.log2(max(pixels, 1.0)))))
