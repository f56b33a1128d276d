"""What becomes of the images of an instant: a camera of no use is left out, one seen later stood elsewhere."""

import numpy as np
import pytest

from dense_localizer.inputs import CameraImage, Inputs
from dense_localizer.params import LocalizerParams
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import Reason
from sphere_nav.params import build
from sphere_nav.spheres.range_alignment import DepthImage
from worlds.localizer import PINHOLE, SMALL_IMAGES, at

PARAMS = build(LocalizerParams, SMALL_IMAGES)
MOUNT = SE3.from_planar(0.5, 0.0, 0.3)
SECOND = 10**9


def test_a_black_image_leaves_the_other_cameras_and_is_named(room):
    good = CameraImage(room.photograph(PINHOLE, at(0.0)), PINHOLE, MOUNT, "front")
    black = CameraImage(np.zeros((120, 160), np.uint8), PINHOLE, MOUNT, "back")
    inputs = Inputs(PARAMS, 1e6)
    report = inputs.check((good, black), SECOND)
    assert [image.name for image in report.images] == ["front"]
    assert report.finding.reason is Reason.LOW_TEXTURE
    assert report.finding.detail == "camera back: image is black"
    assert inputs.check((good,), SECOND).finding.reason is Reason.BAD_STAMP


def test_a_camera_that_was_later_is_where_the_body_went(room):
    image = room.photograph(PINHOLE, at(0.0))
    later = CameraImage(image, PINHOLE, MOUNT, "side", delay_s=0.01)
    step = SE3.exp([1.0, 0.2, 0.0, 0.0, 0.0, 0.5])  # in a second
    (seen,) = Inputs(PARAMS, 1e6).check((later,), 3 * SECOND, velocity=step.log()).images
    expected = step @ SE3.exp(0.01 * step.log()) @ MOUNT
    np.testing.assert_allclose(seen.pose(step).matrix, expected.matrix, atol=1e-12)


def test_a_depth_camera_on_the_vehicle_sees_the_map_from_where_it_is(room):
    beside = SE3.exp([0.05, 0.0, -0.02, 0.0, 0.1, 0.0])
    depth = DepthImage(np.ones((120, 160)), PINHOLE, beside)
    image = CameraImage(room.photograph(PINHOLE, at(0.0)), PINHOLE, MOUNT, depth=depth)
    found = Inputs(PARAMS, 1e6).check((image,), SECOND).depth
    np.testing.assert_allclose(found.T_image_depth.matrix, (MOUNT @ beside).matrix)


def test_still_images_are_a_fault_of_a_camera_that_moves_or_may(room):
    """From 0.05 m/s on it moves."""
    for speed, reason in [(0.04, Reason.NONE), (0.06, Reason.FROZEN), (None, Reason.FROZEN)]:
        params = build(LocalizerParams, SMALL_IMAGES | {"input.allow_still": True})
        inputs, image = Inputs(params, 1e6), CameraImage(room.photograph(PINHOLE, at(0.0)), PINHOLE)
        velocity = None if speed is None else speed * np.array([0.0, 0.6, 0.8, 5.0, 0.0, 0.0])
        found = [inputs.check((image,), (k + 1) * SECOND // 20, velocity=velocity).finding for k in range(4)]
        assert found[-1].reason is reason


@pytest.mark.parametrize(
    ("mount", "delay_s", "velocity"),
    [(None, 0.01, np.ones(6)), (MOUNT, 0.01, None), (MOUNT, 0.0, np.ones(6))],
    ids=["the body itself", "unknown motion", "in time"],
)
def test_a_camera_stays_where_it_is_mounted_unless_the_body_is_known_to_have_moved(room, mount, delay_s, velocity):
    image = CameraImage(room.photograph(PINHOLE, at(0.0)), PINHOLE, mount, delay_s=delay_s)
    (seen,) = Inputs(PARAMS, 1e6).check((image,), SECOND, velocity=velocity).images
    assert seen.T_body_camera is mount


@pytest.mark.parametrize(("pixels_per_radian", "width"), [(1e6, 160), (70.5, 160), (69.0, 80)])
def test_no_image_is_sharper_than_the_map_shows(room, pixels_per_radian, width):
    """The camera has 110 pixels per radian; 1.6 times as many as the map's are kept."""
    image = CameraImage(room.photograph(PINHOLE, at(0.0)), PINHOLE)
    (seen,) = Inputs(PARAMS, pixels_per_radian).check((image,), SECOND).images
    assert seen.pyramid.cameras[0].width == width
