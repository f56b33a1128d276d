"""What becomes of the images of an instant: a camera of no use is left out, one seen later stood elsewhere."""

import numpy as np

from dense_localizer.inputs import CameraImage, Inputs
from dense_localizer.motion_prior import MotionPrior
from dense_localizer.params import LocalizerParams
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import Reason
from sphere_nav.params import build
from worlds.localizer import PINHOLE, SMALL_IMAGES, at

PARAMS = build(LocalizerParams, SMALL_IMAGES)
MOUNT = SE3.from_planar(0.5, 0.0, 0.3)
SECOND = 10**9


def moving_prior(step: SE3) -> MotionPrior:
    prior = MotionPrior(PARAMS.prior)
    prior.start(SE3.identity(), np.eye(6), SECOND)
    prior.correct(step, np.eye(6), 2 * SECOND)
    return prior


def test_a_black_image_leaves_the_other_cameras_and_is_named(room):
    good = CameraImage(room.photograph(PINHOLE, at(0.0)), PINHOLE, MOUNT, "front")
    black = CameraImage(np.zeros((120, 160), np.uint8), PINHOLE, MOUNT, "back")
    inputs = Inputs(PARAMS)
    report = inputs.check((good, black), SECOND, MotionPrior(PARAMS.prior))
    assert [image.name for image in report.images] == ["front"]
    assert report.finding.reason is Reason.LOW_TEXTURE
    assert report.finding.detail == "camera back: image is black"
    assert inputs.check((good,), SECOND, MotionPrior(PARAMS.prior)).finding.reason is Reason.BAD_STAMP


def test_a_camera_that_was_later_is_where_the_body_went(room):
    image = room.photograph(PINHOLE, at(0.0))
    later = CameraImage(image, PINHOLE, MOUNT, "side", delay_s=0.01)
    step = SE3.exp([1.0, 0.2, 0.0, 0.0, 0.0, 0.5])  # in a second
    (seen,) = Inputs(PARAMS).check((later,), 3 * SECOND, moving_prior(step)).images
    expected = step @ SE3.exp(0.01 * step.log()) @ MOUNT
    np.testing.assert_allclose(seen.pose(step).matrix, expected.matrix, atol=1e-12)
