"""Boards before a rig: squares are drawn where the camera has them; a board is seen whole, and from the front alone."""

from types import SimpleNamespace

import numpy as np

from cycab_sim.world.boards import BoardWorld
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.cameras.rig import Rig, RigCamera

SQUARE = 0.1
ROW, COLUMN = np.divmod(np.arange(20), 5)
BOARD = SimpleNamespace(
    name="b",
    columns=5,
    rows=4,
    square_m=SQUARE,
    kind="chessboard",
    points=SQUARE * np.stack([COLUMN, ROW, 0 * ROW], -1),
)
CAMERA = Pinhole(320, 240, 250.0, 250.0, 159.5, 119.5)
RIG = Rig((RigCamera("cam", CAMERA, SE3.identity()),), "one")


def world(turn):
    T_world_board = SE3.from_planar(-0.2, -0.15, 0.0) @ SE3.exp([0.0, 0.0, 1.5, 0.0, turn, 0.0])
    return BoardWorld(RIG, (BOARD,), SE3(T_world_board.matrix[None]), SE3(np.eye(4)[None]))


def test_squares_are_drawn_where_the_camera_has_them():
    made = world(0.3)
    image = made.render(0, 0, np.random.default_rng(0)).astype(float)
    row, column = np.indices((5, 6)).reshape(2, -1)
    middles = SQUARE * np.stack([column - 0.5, row - 0.5, 0 * row], axis=-1)
    u, v = np.rint(CAMERA.project(made.T_camera_board(0, 0, 0).apply(middles))[0]).astype(int).T
    is_dark = (row + column) % 2 == 0
    assert image[v, u][is_dark].max() < 80 < 120 < image[v, u][~is_dark].min()


def test_a_board_is_seen_from_the_front_only_and_with_noise_as_large_as_asked():
    rng = np.random.default_rng(1)
    (seen,) = world(0.3).views(view_of, 0.1, rng)
    truth = CAMERA.project(world(0.3).T_camera_board(0, 0, 0).apply(BOARD.points))[0]
    assert (seen.camera, seen.board, len(seen.corners)) == ("cam", "b", 20)
    assert 0.05 < np.std(seen.pixels - truth) < 0.2
    assert world(np.pi).views(view_of, 0.1, rng) == []


def view_of(camera, instant, board, corners, pixels):
    return SimpleNamespace(camera=camera, instant=instant, board=board, corners=corners, pixels=pixels)
