"""Poses of cameras and boards from sightings whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest

from rig_calibration.boards.assembly import Assembly, Sighting, assemble, board_turns, hand_eye
from rig_calibration.boards.board import Board
from sphere_nav.geometry import SE3

CAMERAS = [SE3.exp([0.1 * k, -0.2 * k, 0.05, 0.1, 0.3 * k, -0.2]) for k in range(3)]
BOARDS = [SE3.exp([1.0 + k, 0.3 * k, -0.4, 0.2, -0.3 * k, 0.1 * k]) for k in range(3)]


def rigs(count):
    rng = np.random.default_rng(0)
    return [SE3.exp([*rng.normal(0, 0.4, 3), *rng.normal(0, 0.5, 3)]) for _ in range(count)]


def batch(poses):
    return SE3(np.stack([T.matrix for T in poses]))


def sighting(camera, instant, board, T_world_rig, error=None):
    T = (T_world_rig @ CAMERAS[camera]).inverse() @ BOARDS[board]
    return Sighting(camera, instant, board, batch([T if error is None else error @ T]), None, None)


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_two_unknown_poses_come_out_of_motions(noise):
    rng = np.random.default_rng(8)  # a camera that alternation from a wrong start does not find
    X, Z = (SE3.exp([*rng.normal(0, 0.4, 3), *rng.uniform(-1.7, 1.7, 3)]) for _ in range(2))
    A = [SE3.exp([*rng.normal(0, 0.4, 3), *rng.normal(0, 0.15, 3)]) for _ in range(6)]
    M = [X.inverse() @ T @ Z @ SE3.exp(noise * rng.normal(size=6)) for T in A]
    found_X, found_Z = hand_eye(batch(M), batch(A))
    assert max(map(float, found_X.distance(X))) < 1e-6 + 3 * noise
    assert max(map(float, found_Z.distance(Z))) < 1e-6 + 3 * noise


def test_a_chain_of_cameras_is_joined_and_each_pose_is_the_true_one():
    instants = rigs(8)
    pairs = [(0, 0), (1, 0), (1, 1), (2, 1)]  # the last camera never sees the first board
    seen = [sighting(c, n, b, T) for n, T in enumerate(instants) for c, b in pairs]
    found = assemble(seen, CAMERAS[0], 3)
    assert set(found.cameras) == {0, 1, 2}
    for index, T in found.cameras.items():
        np.testing.assert_allclose(T.matrix, CAMERAS[index].matrix, atol=1e-9)
    first = BOARDS[0].inverse()  # the board that came first is the world
    np.testing.assert_allclose(found.boards[1].matrix, (first @ BOARDS[1]).matrix, atol=1e-9)
    np.testing.assert_allclose(found.rig_poses(3)[0].matrix, (first @ instants[3]).matrix, atol=1e-9)


@pytest.mark.parametrize(("num_instants", "is_joined"), [(4, True), (3, False)])
def test_a_camera_and_a_board_that_only_see_each_other_are_joined_by_four_instants(num_instants, is_joined):
    instants = rigs(num_instants)
    seen = [sighting(c, n, b, T) for n, T in enumerate(instants) for c, b in ((0, 0), (1, 1))]
    found = assemble(seen, CAMERAS[0], 2)
    assert (1 in found.cameras) == is_joined
    if is_joined:
        assert max(map(float, found.cameras[1].distance(CAMERAS[1]))) < 1e-4


@pytest.mark.parametrize("moved_m", [0.5, 0.0])
def test_false_sightings_are_outvoted(moved_m):
    instants = rigs(9)
    error = SE3.exp([moved_m, 0.2 * moved_m, 0.0, 0.4, 0.0, 0.3])
    seen = [sighting(0, n, 0, T) for n, T in enumerate(instants)]
    seen += [sighting(1, n, 0, T, error if n in (0, 4, 5) else None) for n, T in enumerate(instants)]
    found = assemble(seen, CAMERAS[0], 2)
    np.testing.assert_allclose(found.cameras[1].matrix, CAMERAS[1].matrix, atol=1e-9)
    seen = [sighting(0, 0, board, instants[0], error if board == 2 else None) for board in range(3)]
    poses = Assembly(seen, {0: CAMERAS[0]}, dict(enumerate(BOARDS))).rig_poses(0)
    np.testing.assert_allclose(poses.matrix, [instants[0].matrix] * 2, atol=1e-9)  # not that by the false one


def test_what_only_one_end_of_is_known_or_the_first_camera_has_not_seen_joins_nothing():
    (T,) = rigs(1)
    seen = [sighting(c, 0, b, T) for c, b in ((0, 0), (0, 1), (1, 0), (1, 1))]
    found = Assembly(seen, {0: CAMERAS[0]}, {0: BOARDS[0]})
    np.testing.assert_allclose(found.rig_poses(0)[0].matrix, T.matrix, atol=1e-9)
    assert not len(Assembly(seen, {0: CAMERAS[0]}).rig_poses(0).matrix)
    found = assemble([sighting(1, 0, 0, rigs(1)[0])], CAMERAS[0], 2)
    assert (found.cameras, found.boards) == ({}, {})


@pytest.mark.parametrize("size", [(6, 4), (5, 5), (4, 4), (5, 4)])
def test_turns_of_a_board_put_its_corners_on_each_other(size):
    board = Board("b", *size, 0.1)
    found = board_turns(board)
    assert len(found.matrix) == len(board.turns) == {(6, 4): 2, (5, 5): 2, (4, 4): 4, (5, 4): 1}[size]
    for T, turn in zip(found, board.turns, strict=True):
        np.testing.assert_allclose(T.apply(board.points), board.points[turn], atol=1e-12)
        assert np.linalg.det(T.rotation) == pytest.approx(1.0)
