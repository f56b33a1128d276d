"""False corners cost themselves only; boards that are none, turned or mirrored are named and do not move the rig."""

from dataclasses import replace

import numpy as np
import pytest

from rig_calibration.boards import rejection
from rig_calibration.boards.board import Board
from rig_calibration.boards.rejection import noise_px, reject, view_medians
from rig_calibration.boards.views import BoardView, observations
from rig_calibration.calibrate import CameraSpec, calibrate
from sphere_nav.geometry.cameras.rig import Rig
from worlds.boards import BoardWorld, boards_around, ring_rig, wandering

NOISE_PX = 0.1


@pytest.fixture
def seen():
    """Two cameras, six instants, two boards: 24 views of 20 corners."""
    camera, instant, board = np.indices((2, 6, 2)).reshape(3, -1)
    points = [np.zeros((20, 3))] * 24
    return observations(camera, instant, board, points, [np.zeros((20, 2))] * 24)


@pytest.fixture
def errors(seen, rng):
    return rng.normal(0.0, NOISE_PX, seen.pixels.shape)


def test_some_false_corners_cost_only_themselves(seen, errors):
    errors[[3, 5, 7, 9]] += 40.0  # 4 of the 20 corners of one view: its RMS is 25 px
    kept, dropped = reject(seen, errors, np.ones(480))
    assert dropped == {}
    np.testing.assert_array_equal(np.flatnonzero(kept == 0), [3, 5, 7, 9])


def test_of_one_instant_only_the_worst_view_goes_at_a_time(seen, errors):
    errors[seen.view == 0] += 9.0  # cause
    errors[seen.view == 1] += 5.0  # pulled by it: the same instant
    errors[seen.view == 2] += 5.0  # another instant
    kept, dropped = reject(seen, errors, np.ones(480))
    assert list(dropped) == [0, 2]
    assert np.all(kept[seen.view == 1] == 1.0)


def test_corners_that_do_not_count_are_not_judged(seen, errors):
    errors[:20] = np.nan
    kept = np.ones(480)
    kept[:20] = 0.0
    assert [seen.rows[view] for view in (0, 1, -1)] == [slice(0, 20), slice(20, 40), slice(460, 480)]
    medians = view_medians(seen, np.linalg.norm(errors, axis=-1), kept)
    assert np.flatnonzero(np.isnan(medians)).tolist() == [0]
    assert reject(seen, errors, kept)[1] == {}


def test_noise_is_the_deviation_of_one_coordinate_whatever_a_third_of_the_corners_is(rng):
    errors = rng.normal(0.0, 0.3, (20_000, 2))
    assert noise_px(errors, np.ones(20_000)) == pytest.approx(0.3, rel=0.02)
    errors[:2000] = 50.0
    assert noise_px(errors, np.arange(20_000) >= 2000) == pytest.approx(0.3, rel=0.02)
    assert 0.3 < noise_px(errors, np.ones(20_000)) < 0.36
    assert noise_px(errors, np.zeros(20_000)) == noise_px(0.0 * errors, np.ones(20_000)) == 1e-9


def even(seen, size):
    """Residuals of one length in all directions."""
    angles = np.arange(len(seen.pixels)) * 2.4
    return size * np.stack([np.cos(angles), np.sin(angles)], axis=1)


@pytest.mark.parametrize(("times", "is_kept"), [(4.9, True), (5.1, False)])
def test_a_corner_goes_beyond_five_deviations_of_its_camera(seen, times, is_kept):
    errors = even(seen, 1.1774)  # medians of normal errors with a deviation of 1 px
    errors[seen.view >= 12] *= 3.0  # the other camera
    errors[7], errors[-3] = [times, 0.0], [0.0, -3.0 * times]
    kept, dropped = reject(seen, errors, np.ones(480))
    assert dropped == {}
    np.testing.assert_array_equal(np.flatnonzero(kept == 0), [] if is_kept else [7, 477])


@pytest.mark.parametrize(
    ("usual", "size", "is_kept"), [(1.0, 3.9, True), (1.0, 4.1, False), (1e-3, 0.29, True), (1e-3, 0.31, False)]
)
def test_a_view_goes_beyond_four_times_the_others_or_three_times_the_least(monkeypatch, seen, usual, size, is_kept):
    errors = even(seen, usual)
    errors[seen.view == 5] *= size / usual
    if usual > 0.1:  # else corners are left out from 0.1 px on
        monkeypatch.setattr(rejection, "CORNER_LIMIT", 1e4)
    dropped = reject(seen, errors, np.ones(480))[1]
    if usual < 0.1 and is_kept:
        assert "corners fit" in dropped[5]
    else:
        assert ("median" in dropped.get(5, "")) != is_kept
    assert set(dropped) <= {5}


@pytest.mark.parametrize(("num_false", "is_kept"), [(10, True), (11, False)])
def test_half_of_its_corners_must_fit_for_a_view_to_count(monkeypatch, seen, errors, num_false, is_kept):
    errors[:num_false:1] = 3.0 * np.sign(np.arange(num_false)[:, None] % 2 - 0.5)
    errors[num_false:20] = 0.01
    monkeypatch.setattr(rejection, "VIEW_RATIO", 1e3)
    dropped = reject(seen, errors, np.ones(480))[1]
    assert (0 not in dropped) == is_kept
    if not is_kept:
        assert dropped[0] == "9 of 20 corners fit"


@pytest.fixture(scope="module")
def world():
    rng = np.random.default_rng(11)
    boards, poses = boards_around(Board, 4, 1.4, rng)
    whole = ring_rig((640, 480))
    return BoardWorld(Rig(whole.cameras[:3], "three"), boards, poses, wandering(30, rng))


@pytest.fixture(scope="module")
def views(world):
    return world.views(BoardView, NOISE_PX, np.random.default_rng(12))


def swapped(view, board):
    """Return the view with its corners numbered from the other end: a board taken for upside down."""
    return replace(view, corners=view.corners[::-1])


def mirrored(view, board):
    """Return the view numbered from right to left, as a board in a mirror."""
    grid = np.arange(board.num_corners).reshape(board.rows, board.columns)
    return replace(view, corners=grid[:, ::-1].ravel())


def crowded(views):
    """Return the indices of views, one an instant, of instants with three or more."""
    of_instant = {}
    for index, view in enumerate(views):
        of_instant.setdefault(view.instant, []).append(index)
    return [indices[number % len(indices)] for number, indices in enumerate(of_instant.values()) if len(indices) >= 3]


@pytest.mark.slow
def test_a_false_view_is_named_and_does_not_move_the_rig(world, views):
    boards = {board.name: board for board in world.boards if (board.columns + board.rows) % 2}
    spoiled, false = list(views), []
    for index in crowded(views)[:4]:
        if views[index].board in boards:  # those that look alike upside down are turned back, not left out
            fault = (swapped, mirrored)[len(false) % 2]
            spoiled[index] = fault(views[index], boards[views[index].board])
            false.append(views[index].label)
    parts = world.rig.cameras
    specs = [CameraSpec(p.name, p.camera.model, (p.camera.width, p.camera.height), p.camera) for p in parts]
    found = calibrate(specs, world.boards, spoiled, world.rig.cameras[0].T_rig_camera)
    assert len(false) >= 2
    assert set(found.dropped) == set(false)
    for index in (1, 2):
        error = (found.rig.cameras[index].T_rig_camera.inverse() @ world.rig.cameras[index].T_rig_camera).log()
        std = found.spread.pose_std[index]
        assert np.linalg.norm(error[:3]) < 4.0 * np.linalg.norm(std[:3])  # 4 standard deviations of a norm: never
        assert np.linalg.norm(error[3:]) < 4.0 * np.linalg.norm(std[3:])
