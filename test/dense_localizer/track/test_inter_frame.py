"""The rotation between two images: asked for where a prediction is not supported, measured only then (M15 eq. 20)."""

from dataclasses import replace

import numpy as np
import pytest

from dense_localizer.params import LocalizerParams
from dense_localizer.track.inter_frame import InterFrame
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.localization.status import State
from sphere_nav.params import build
from sphere_nav.photometric import build_pyramid
from sphere_nav.photometric.align.problem import RigImage
from worlds.localizer import FISHEYE, PINHOLE, SMALL_IMAGES, Run, at, error, make_localizer

PARAMS = build(LocalizerParams, SMALL_IMAGES).registration
MOUNT = SE3.exp([0.3, 0.0, 0.1, 0.2, -0.4, 0.1])
NARROW = Pinhole(320, 240, 573.0, 573.0, 159.5, 119.5)  # 5 degrees are 50 pixels


def image_at(room, pose, camera=PINHOLE, mount=None, seed=0):
    T_room_camera = pose if mount is None else pose @ mount
    return RigImage(build_pyramid(room.photograph(camera, T_room_camera, seed), camera, PARAMS.pyramid), mount)


@pytest.mark.parametrize("camera", [PINHOLE, FISHEYE], ids=lambda camera: camera.model)
@pytest.mark.parametrize("mount", [None, MOUNT], ids=["body", "mounted"])
def test_a_prediction_that_is_right_is_supported_and_a_wrong_one_is_measured(room, camera, mount):
    turn = SE3.exp([0, 0, 0, 0.02, np.deg2rad(4), -0.01])
    before, now = image_at(room, at(0.0), camera, mount), image_at(room, at(0.0) @ turn, camera, mount, 1)
    inter = InterFrame(PARAMS)
    inter.images = (before,)
    assert inter.refine([now], turn) is None  # what it measures is no better
    assert inter.refine([now], SE3.identity()).distance(turn)[1] < np.deg2rad(0.8)
    assert inter.refine([now], turn) is None  # it is not even measured


def test_without_images_of_the_same_camera_nothing_is_said(room):
    inter, image = InterFrame(PARAMS), image_at(room, at(0.0))
    for before in ((), (replace(image, name="left"),)):
        inter.images = before
        assert inter.refine([image], SE3.identity()) is None


def test_five_degrees_and_fifty_pixels_between_images_at_15_hz_are_tracked(room, room_map):
    run, step_ns = Run(room, make_localizer(room_map), NARROW), 66_666_667
    still = [at(-1.0 + 0.01 * k) for k in range(7)]
    for pose in still:
        last = run.see(pose, step_ns=step_ns)
    assert last.status.state is State.TRACKING
    for k in range(1, 7):  # to one side and back: what velocity predicts is off by 5 to 10 degrees
        pose = at(-0.94 + 0.01 * k, 0.0, np.deg2rad(5 * (k % 2)))
        last = run.see(pose, step_ns=step_ns)
        assert (last.status.state, last.status.reason) == (State.TRACKING, "")
        meters, radians = error(last, pose)
        assert meters < 0.06  # spheres of 81 pixels a radian in an image of 573
        assert radians < 0.01
