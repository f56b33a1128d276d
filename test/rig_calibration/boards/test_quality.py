"""What leaves small residuals and a wrong lens is warned of by name; good images are not."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rig_calibration.boards.board import Board
from rig_calibration.boards.bundle import camera_state, rig_problem
from rig_calibration.boards.quality import disagreements, lens_chance, quality_warnings
from rig_calibration.boards.validation import Validation
from rig_calibration.boards.views import BoardView, observations
from rig_calibration.calibrate import CameraSpec, calibrate, check_views
from sphere_nav.geometry import SE3, Pinhole, so3
from sphere_nav.geometry.cameras.lens import lens_of
from sphere_nav.geometry.cameras.rig import Rig, RigCamera
from worlds.boards import BoardWorld

CAMERA = Pinhole(640, 480, 500.0, 501.0, 322.0, 238.0, (-0.1, 0.02, 0.0, 0.0, 0.0))
BOARD = Board("board", 7, 5, 0.05)
TILT_DEG, FRONTAL_DEG = (12.0, 35.0), 2.0  # of a board before a camera; of one that only faces it
EXTENT = (0.28, 0.45)  # of the image's width that it takes


def board_poses(camera, board, count, flaw, rng):
    """Return T_camera_board (count,) with the whole board in the image, in the part of it that the flaw leaves."""
    low, high = np.zeros(2), np.array([camera.width, camera.height], float)
    if flaw == "one side":
        axis, side = rng.integers(2), rng.integers(2)
        low[axis], high[axis] = (0.0, 0.55 * high[axis]) if side else (0.45 * high[axis], high[axis])
    width = (board.columns + 1) * board.square_m
    poses = []
    shrink = 1.0 if flaw != "one side" else 0.8
    while len(poses) < count:
        target = rng.uniform(low, high)
        angle = np.radians(FRONTAL_DEG * rng.random() if flaw == "frontal" else rng.uniform(*TILT_DEG))
        about = rng.uniform(0, 2 * np.pi)
        turn = so3.exp(angle * np.array([np.cos(about), np.sin(about), 0.0])) @ so3.exp([0, 0, rng.normal(0, 0.1)])
        distance = camera.pixels_per_radian * width / (shrink * rng.uniform(*EXTENT) * camera.width)
        T = SE3.from_parts(turn, distance * camera.unproject(target) - turn @ board.points.mean(axis=0))
        pixels, is_seen = camera.project(T.apply(board.points))
        if is_seen.all() and np.all((pixels > low + 8) & (pixels < high - 8)):
            poses.append(T.matrix)
    return SE3(np.stack(poses))


def seen(count=14, flaw="", blur=0.7):
    """Return views (count,) of a board, and T_camera_board of each."""
    rng = np.random.default_rng(5)
    rig = Rig((RigCamera("cam", CAMERA, SE3.identity()),), "one")
    poses = board_poses(CAMERA, BOARD, count, flaw, rng)
    world = BoardWorld(rig, (BOARD,), SE3(np.eye(4)[None]), poses.inverse())
    return [replace(view, blur_px=blur) for view in world.views(BoardView, 0.05, rng)], poses


def judged(views, poses, halves=None):
    """Return the warnings about views whose lens and poses are right."""
    number = len(views)
    own = observations([0] * number, range(number), [0] * number, [BOARD.points] * number, [v.pixels for v in views])
    problem = rig_problem(("pinhole",), ((640, 480),), own)
    halves = halves or Validation(np.zeros(1), np.full((1, 6), np.nan), np.full(1, np.nan))  # not known
    state = camera_state(lens_of(CAMERA), poses)
    return quality_warnings(["cam"], problem, state, np.ones(len(own.pixels)), views, halves)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({}, ""),
        ({"blur": 2.2}, "cam: blurred: edges of the boards have a standard deviation of 2.2 px, expected up to 1.4"),
        ({"count": 7}, "cam: few views: 7 instants, expected 10 or more"),
        ({"flaw": "frontal"}, "cam: no tilt: boards differ by "),
        ({"flaw": "one side"}, "cam: one side only: corners cover of the "),
    ],
)
def test_each_flaw_is_warned_of_by_name(arguments, word):
    lines = judged(*seen(**arguments))
    assert bool(lines) == bool(word)
    assert all(line.startswith(word) for line in lines)


def test_halves_that_disagree_are_warned_of_with_both_numbers():
    halves = Validation(np.zeros(1), np.array([[0.0, 0.006, 0.0, 0.0, 0.0, 0.01]]), np.array([0.015]))
    lines = judged(*seen(), halves)
    assert lines == ["cam: halves of the images disagree by 1.50 % of the focal length, 6.0 mm, 0.57 deg"]


@pytest.fixture(scope="module")
def found():
    """One camera that nobody knows anything of, by few views."""
    return calibrate([CameraSpec("cam", "pinhole", (640, 480))], [BOARD], seen(7)[0])


def test_few_views_give_a_lens_and_a_warning(found):
    assert found.camera(0).fx == pytest.approx(CAMERA.fx, rel=0.01)
    assert found.camera(0).cy == pytest.approx(CAMERA.cy, abs=3.0)
    assert found.dropped == {}
    assert any(line == "cam: few views: 7 instants, expected 10 or more" for line in found.warnings)
    assert not any("no tilt" in line for line in found.warnings)


OWN = SimpleNamespace(
    camera=Pinhole(640, 480, 300.0, 300.0, 320.0, 240.0),
    lens_covariance=np.diag([0.04, 0.04, 0.01, 0.01, *[0.0] * 8]),  # the distortion is held
)
LENS = lens_of(OWN.camera)


def test_the_chance_of_a_change_is_that_of_its_deviations(rng):
    changes = rng.multivariate_normal(np.zeros(12), OWN.lens_covariance, 2000)
    chances = np.array([lens_chance(OWN, LENS + change) for change in changes])
    for level in (0.01, 0.1, 0.5):
        assert np.mean(chances < level) == pytest.approx(level, abs=4 * np.sqrt(level * (1 - level) / 2000))


def test_a_lens_that_changes_is_told_by_what_moved():
    moved = LENS + np.array([0.1, -1.5, *[0.0] * 10])
    (line, _) = disagreements(["a", "b"], [OWN, OWN], np.stack([LENS, moved]))
    assert line.startswith("b: by itself and with the others it is not the same camera: fx, fy, cx, cy moved by ")
    assert "-1.50" in line
    assert disagreements(["a", "b"], [OWN, OWN], np.stack([LENS] * 2)) == []
    assert disagreements(["b"], [OWN], moved[None]) == []


SMALL_BOARD = Board("b", 6, 4, 0.1)


def seen_by(camera, instant, count=24):
    return BoardView(camera, str(instant), "b", np.arange(count), np.zeros((count, 2)))


def test_what_is_missing_is_told_by_the_name_of_the_camera():
    good = [seen_by("a", n) for n in range(4)]
    check_views(["a"], [SMALL_BOARD], good)
    for views, said in (
        ([], "expected a 6x4 chessboard in some images, found none in any"),
        (good, "camera b: expected a 6x4 chessboard in some of its images, found none"),
        ([*good, *(seen_by("b", n, 8 - (n == 2)) for n in range(4))], "in at least 4 of its images, found 3"),
    ):
        with pytest.raises(ValueError, match=said):
            check_views(["a", "b"], [SMALL_BOARD], views)
