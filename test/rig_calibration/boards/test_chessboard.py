"""Several chessboards in an image are told apart by their size, and the search ends where there is none."""

import numpy as np
import pytest

from rig_calibration.boards import detect
from rig_calibration.boards.board import Board
from rig_calibration.boards.detect import chessboard_candidates, detect_all
from sphere_nav.geometry import SE3, Pinhole, Rig, RigCamera, so3
from sphere_nav.geometry.cameras.rig import T_BODY_OPTICAL
from worlds.boards import BoardWorld

BOARDS = (Board("wide", 7, 4, 0.06), Board("high", 5, 6, 0.06), Board("absent", 9, 6, 0.06))


@pytest.fixture(scope="module", params=[1, pytest.param(2, marks=pytest.mark.slow)], ids=["small", "halved"])
def seen(request):
    """An image with two boards side by side, of 300 rows or of 600, that are searched at half size; and the truth."""
    scale = request.param
    camera = Pinhole(
        400 * scale, 300 * scale, 260.0 * scale, 260.0 * scale, 199.5 * scale, 149.5 * scale, (-0.05, 0.01)
    )
    poses = []
    for board, left in zip(BOARDS[:2], (0.36, -0.3), strict=True):
        R = T_BODY_OPTICAL.rotation @ so3.exp([0.2, -0.2, 0.1])
        poses.append(SE3.from_parts(R, [0.9, left, 0.0] - R @ board.points.mean(axis=0)).matrix)
    rig = Rig((RigCamera("a", camera, T_BODY_OPTICAL),))
    world = BoardWorld(rig, BOARDS[:2], SE3(np.stack(poses)), SE3(np.eye(4)[None]))
    truth = {b.name: camera.project(world.T_camera_board(0, 0, n).apply(b.points))[0] for n, b in enumerate(BOARDS[:2])}
    return world.render(0, 0, np.random.default_rng(1)), truth


def test_boards_are_told_apart_by_their_size(seen):
    image, truth = seen
    found = detect_all(image, BOARDS)
    assert set(found) == {"wide", "high"}
    for name, (numbers, pixels) in found.items():
        assert np.abs(pixels - truth[name][numbers]).max() < 0.3  # noise of 2 of 180 grey levels, windows of 2 to 7 px


def test_a_candidate_that_the_border_cuts_is_passed_over(seen, monkeypatch):
    image, truth = seen
    cut = truth["wide"] - [truth["wide"][:, 0].min() + 1.0, 0.0]  # as the detectors do now and then: guessed corners
    monkeypatch.setattr(detect, "chessboard_candidates", lambda gray, boards: [(boards[0], [cut])])
    assert detect_all(image, BOARDS) == {}


def test_a_single_board_is_found_at_once():
    for side in (30, 5):
        squares = np.kron(np.indices((5, 8)).sum(axis=0) % 2 * 255, np.ones((side, side)))
        gray = np.pad(squares, 30, constant_values=255).astype(np.uint8)
        ((_, found),) = chessboard_candidates(gray, BOARDS[:1])
        assert np.ptp(next(found), axis=0) == pytest.approx([6.0 * side, 3.0 * side], abs=1.0)
        assert set(detect_all(gray, BOARDS[:1])) == {"wide"}
