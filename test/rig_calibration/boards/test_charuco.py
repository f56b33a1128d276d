"""ChArUco boards, rendered: corners by their numbers, seen in part, several in an image, and a rig from them."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rig_calibration.boards.board import Board
from rig_calibration.boards.detect import check_markers, detect_all
from rig_calibration.boards.views import BoardView
from rig_calibration.calibrate import CameraSpec, calibrate
from sphere_nav.geometry import SE3, Fisheye, Rig, RigCamera, so3
from sphere_nav.geometry.cameras.rig import T_BODY_OPTICAL
from worlds.boards import BoardWorld, pattern

NUM_INSTANTS = 14
BOARDS = tuple(Board(f"b{n}", 6, 4, 0.1, "charuco", 0.075, first_marker=20 * n) for n in range(2))
CAMERA = Fisheye(480, 360, 230.0, 229.5, 241.3, 177.2, (0.03, -0.012, 0.004, -0.0006))


def placed(board, yaw, distance):
    """Return `T_world_board` of a board that faces the origin from this direction."""
    turn = so3.exp([0.0, 0.0, yaw])
    R = turn @ T_BODY_OPTICAL.rotation @ so3.exp([0.15, -0.2, 0.05])
    return SE3.from_parts(R, turn @ [distance, 0.0, 0.0] - R @ board.points.mean(axis=0)).matrix


@pytest.fixture(scope="module")
def world():
    """Two cameras back to back, which never see the same board at once, two boards, a rig that turns and tilts."""
    rng = np.random.default_rng(2)
    backwards = SE3.exp([-0.1, 0.02, 0.03, 0.0, 0.0, np.pi]) @ T_BODY_OPTICAL
    rig = Rig((RigCamera("front", CAMERA, T_BODY_OPTICAL), RigCamera("back", replace(CAMERA, cx=238.0), backwards)))
    boards = SE3(np.stack([placed(BOARDS[0], 0.0, 0.8), placed(BOARDS[1], np.pi, 0.8)]))
    poses = []
    for number in range(NUM_INSTANTS):
        R = so3.exp([0.0, 0.0, np.pi * (number % 2) + rng.uniform(-0.2, 0.2)]) @ so3.exp(
            [*rng.uniform(-0.4, 0.4, 2), 0]
        )
        poses.append(SE3.from_parts(R, rng.uniform(-0.2, 0.2, 3)).matrix)
    return BoardWorld(rig, BOARDS, boards, SE3(np.stack(poses)))


@pytest.fixture(scope="module")
def images(world):
    rng = np.random.default_rng(3)
    return {(c, i): world.render(c, i, rng) for c in range(2) for i in range(NUM_INSTANTS)}


@pytest.fixture(scope="module")
def views(world, images):
    return [
        BoardView(world.rig.cameras[camera].name, f"{instant:02d}", name, *seen)
        for (camera, instant), image in images.items()
        for name, seen in detect_all(image, BOARDS).items()
    ]


@pytest.mark.slow
def test_every_corner_is_where_its_number_says(world, views):
    errors, cut = [], 0
    for view in views:
        camera, index = ("front", "back").index(view.camera), int(view.board[1])
        truth = world.T_camera_board(camera, int(view.instant), index).apply(BOARDS[index].points[view.corners])
        errors.append(view.pixels - world.rig.cameras[camera].camera.project(truth)[0])
        cut += len(view.corners) < BOARDS[index].num_corners
    assert len(views) >= NUM_INSTANTS
    assert cut >= 2  # boards that the image cuts are used all the same
    assert np.sqrt(np.mean(np.concatenate(errors) ** 2)) < 0.1  # px a coordinate; windows of 2 to 3 px, noise 2 of 180
    assert np.abs(np.concatenate(errors)).max() < 1.0  # none is that of a neighbour


@pytest.mark.slow
def test_cameras_that_share_no_view_are_joined_by_the_motion(world, views):
    parts = world.rig.cameras
    specs = [CameraSpec(part.name, "fisheye", (480, 360)) for part in parts]
    found = calibrate(specs, BOARDS, views, parts[0].T_rig_camera)
    error = (found.rig.cameras[1].T_rig_camera.inverse() @ parts[1].T_rig_camera).log()
    std = found.spread.pose_std[1]
    assert found.dropped == {}
    assert np.all(found.spread.pose_std < [[0.01] * 3 + [0.01] * 3])  # m and rad, else the next lines say little
    assert np.linalg.norm(error[:3]) < 5.0 * np.linalg.norm(std[:3])
    assert np.linalg.norm(error[3:]) < 5.0 * np.linalg.norm(std[3:])


@pytest.mark.slow
def test_two_boards_in_one_image_are_told_apart_by_their_markers(world):
    poses = SE3(np.stack([placed(BOARDS[0], 0.47, 0.8), placed(BOARDS[1], -0.47, 0.8)]))
    before = replace(world, T_world_board=poses, T_world_rig=SE3(np.eye(4)[None]))
    image = before.render(0, 0, np.random.default_rng(4))
    found = detect_all(image, BOARDS)
    assert set(found) == {"b0", "b1"}
    assert found["b0"][1][:, 0].mean() < found["b1"][1][:, 0].mean()  # b1 stands to the right


@pytest.mark.slow
def test_a_board_that_is_there_twice_is_not_guessed(images):
    image = next(image for image in images.values() if detect_all(image, BOARDS[:1]))
    assert not detect_all(np.hstack([image, image]), BOARDS[:1])


def test_edges_of_markers_do_not_bend_the_corners():
    """A board straight ahead, turned a little: a window that holds a marker pulls corners off by a tenth of a pixel."""
    side = 24
    modules = np.where(pattern(BOARDS[0]), 35, 215).astype(np.uint8).transpose(0, 2, 1, 3)
    paper = np.pad(modules.reshape(5 * 8, 7 * 8).repeat(3, 0).repeat(3, 1), side, constant_values=215)
    turn = cv2.getRotationMatrix2D((100.0, 80.0), 8.0, 1.0)
    image = cv2.GaussianBlur(cv2.warpAffine(paper, turn, paper.shape[::-1], borderValue=215), (0, 0), 0.7)
    numbers, corners = detect_all(image, BOARDS[:1])["b0"]
    truth = side * (BOARDS[0].points[numbers, :2] / 0.1 + 2.0) - 0.5
    off = corners - truth @ turn[:, :2].T - turn[:, 2]
    assert len(numbers) >= 20
    assert np.abs(off).max() < 0.1


def test_a_dictionary_must_be_there_and_hold_the_markers():
    check_markers(replace(BOARDS[0], first_marker=250 - 17))
    with pytest.raises(ValueError, match="dictionary: expected 251 markers for 6x4 corners, found 250"):
        check_markers(replace(BOARDS[0], first_marker=250 - 16))
    for other in ("ArucoDetector", "CORNER_REFINE_SUBPIX"):  # no number; the number of something else
        with pytest.raises(ValueError, match="board 'b0': dictionary: expected a name such as DICT_4X4_250"):
            check_markers(replace(BOARDS[0], dictionary=other))
