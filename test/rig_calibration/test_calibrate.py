"""A known rig comes back from views of boards; every kind of bad input is told by name."""

import dataclasses

import numpy as np
import pytest

from rig_calibration.boards.board import Board
from rig_calibration.boards.intrinsics import board_pose
from rig_calibration.boards.views import BoardView
from rig_calibration.calibrate import CameraSpec, calibrate
from rig_calibration.constants import MAX_POSITION_STD_M
from sphere_nav.geometry import SE3
from sphere_nav.geometry.cameras.rig import Rig
from worlds.boards import BoardWorld, boards_around, ring_rig, wandering


@pytest.fixture(scope="module")
def world():
    rng = np.random.default_rng(3)
    boards, poses = boards_around(Board, 2, 1.5, rng)
    whole = ring_rig((640, 480))
    return BoardWorld(Rig(whole.cameras[:2], "two"), boards, poses, wandering(36, rng))


@pytest.fixture(scope="module")
def calibrated(world):
    views = world.views(BoardView, 0.1, np.random.default_rng(4))
    views[3].pixels[:] += 40.0 * np.random.default_rng(5).normal(size=views[3].pixels.shape)  # a false detection
    specs = [CameraSpec(p.name, p.camera.model, (p.camera.width, p.camera.height)) for p in world.rig.cameras]
    found = calibrate(specs, world.boards, views, world.rig.cameras[0].T_rig_camera)
    return found, views[3].label, specs, views


def test_a_known_rig_comes_back_whatever_a_false_view_says(world, calibrated):
    found, false = calibrated[:2]
    assert set(found.dropped) == {false}
    assert not any("not the same camera" in line for line in found.warnings)
    error = (found.rig.cameras[1].T_rig_camera.inverse() @ world.rig.cameras[1].T_rig_camera).log()
    std = found.spread.pose_std[1]
    assert np.linalg.norm(error) < 5.0 * np.linalg.norm(std)  # five of its own standard deviations
    assert np.linalg.norm(std[:3]) < MAX_POSITION_STD_M  # else the line above says little
    assert found.rig.cameras[0].camera.fx == pytest.approx(world.rig.cameras[0].camera.fx, rel=0.005)


@pytest.mark.slow
def test_images_that_were_not_taken_at_one_time_are_warned_of(world, calibrated):
    """The second camera's images are of moments at which the rig stood elsewhere, by 3 mm and 0.2 degrees."""
    _, _, specs, _ = calibrated
    rng = np.random.default_rng(8)
    shaken = SE3.exp(rng.normal(0.0, 0.003, (len(world.T_world_rig.matrix), 6)))
    late = dataclasses.replace(world, T_world_rig=world.T_world_rig @ shaken)
    views = [view for view in world.views(BoardView, 0.1, rng) if view.camera == "cam0"]
    views += [view for view in late.views(BoardView, 0.1, rng) if view.camera == "cam1"]
    found = calibrate(specs, world.boards, views, world.rig.cameras[0].T_rig_camera)
    lines = [line for line in found.warnings if "by itself and with the others it is not the same camera" in line]
    assert lines
    assert found.warnings[-1].startswith("were the images of each instant taken at one time")


def test_a_board_beyond_90_degrees_is_found():
    board, T = Board("b", 9, 6, 0.1), SE3.exp([0.9, 0.1, -0.3, 0.2, 1.7, 0.1])
    points = T.apply(board.points)
    found = board_pose(points / np.linalg.norm(points, axis=-1, keepdims=True), board.points)
    np.testing.assert_allclose(found.matrix, T.matrix, atol=1e-6)
