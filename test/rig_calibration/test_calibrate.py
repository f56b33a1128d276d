"""A known rig comes back from views of boards; every kind of bad input is told by name."""

import dataclasses

import numpy as np
import pytest

from cycab_sim.world.boards import BoardWorld, boards_around, ring_rig, wandering
from rig_calibration.boards import checks
from rig_calibration.boards.assembly import board_turns, hand_eye
from rig_calibration.boards.board import Board, check_distinct, parse_size
from rig_calibration.boards.detect import detect_all
from rig_calibration.boards.intrinsics import board_pose, other_pose
from rig_calibration.boards.lens import J_lens, camera_from_vector, lens_of, project_points
from rig_calibration.boards.linearize import jacobian, residuals
from rig_calibration.boards.report import calibration_as_mapping, coverage
from rig_calibration.boards.views import BoardView
from rig_calibration.calibrate import CameraSpec, calibrate
from rig_calibration.params import CalibrationParams
from sphere_nav.geometry import SE3, Fisheye, OCam, Omni, Pinhole
from sphere_nav.geometry.cameras.rig import Rig

PARAMS = CalibrationParams()
CAMERAS = (
    Pinhole(640, 480, 400.0, 402.0, 318.0, 243.0, (-0.2, 0.05, 1e-3, -5e-4, -0.01)),
    Fisheye(640, 480, 250.0, 251.0, 321.0, 238.0, (0.03, -0.012, 0.004, -0.0006)),
    Omni(640, 480, 500.0, 501.0, 321.0, 238.0, 1.3, (-0.12, 0.06, 2e-3, -3e-3)),
    OCam(640, 480, 321.0, 238.0, (230.0, 0.0, -1.3e-3, 1.1e-6, -3e-9), 1.002, 4e-3),
)


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
    found = calibrate(specs, world.boards, views, PARAMS, world.rig.cameras[0].T_rig_camera)
    return found, views[3].label, specs, views


@pytest.mark.slow
def test_a_known_rig_comes_back(world, calibrated):
    found = calibrated[0]
    error = (found.rig.cameras[1].T_rig_camera.inverse() @ world.rig.cameras[1].T_rig_camera).log()
    std = found.spread.pose_std[1]
    assert np.linalg.norm(error) < 5.0 * np.linalg.norm(std)  # five of its own standard deviations
    assert np.linalg.norm(std[:3]) < PARAMS.max_position_std_m  # else the line above says little
    assert found.rig.cameras[0].camera.fx == pytest.approx(world.rig.cameras[0].camera.fx, rel=0.005)


@pytest.mark.slow
def test_a_false_detection_is_named(calibrated):
    found, label, _, _ = calibrated
    assert list(found.dropped) == [label]


@pytest.mark.slow
def test_report_has_every_camera(calibrated):
    report = calibration_as_mapping(calibrated[0])
    assert set(report["cameras"]) == {"cam0", "cam1"}
    assert report["noise_px"] == pytest.approx(0.1, rel=0.1)
    assert np.all(coverage(calibrated[0]) > 10.0)


@pytest.mark.slow
def test_a_camera_without_a_board_is_named(world, calibrated):
    _, _, specs, views = calibrated
    with pytest.raises(ValueError, match="camera cam1: expected a 9x6"):
        calibrate(specs, world.boards, [view for view in views if view.camera == "cam0"], PARAMS)


@pytest.mark.slow
def test_no_board_at_all_is_told(world, calibrated):
    with pytest.raises(ValueError, match="found none in any"):
        calibrate(calibrated[2], world.boards, [], PARAMS)


def test_cameras_apart_are_named():
    with pytest.raises(ValueError, match="found back apart from front"):
        checks.check_joined(["front", "back"], {0})


@pytest.mark.parametrize("camera", CAMERAS, ids=lambda camera: camera.model)
def test_lens_agrees_with_the_camera_and_its_derivative_is_right(camera, rng):
    points = np.concatenate([rng.uniform(-0.5, 0.5, (20, 2)), np.ones((20, 1))], axis=-1)
    if camera.model != "pinhole":
        points[:, 2] = np.linspace(0.1, 1.0, 20)
    lens = lens_of(camera)
    assert camera_from_vector(camera.model, (640, 480), lens, 5) == camera
    np.testing.assert_allclose(project_points(camera.model, lens, points), camera.project(points)[0], atol=1e-9)
    steps = 1e-6 * np.eye(12)
    numeric = np.stack(
        [project_points(camera.model, lens + s, points) - project_points(camera.model, lens - s, points) for s in steps]
    )
    np.testing.assert_allclose(J_lens(camera.model, lens, points), np.moveaxis(numeric, 0, -1) / 2e-6, atol=1e-4)


@pytest.mark.slow
def test_jacobian_of_the_adjustment_is_right(calibrated):
    problem, state = calibrated[0].start.problem, calibrated[0].state
    J, view, h = jacobian(problem, state), problem.seen.view, 1e-6
    camera, board, instant = problem.seen.camera[view], problem.seen.board[view], problem.seen.instant[view]
    num_cameras, num_poses = len(problem.models), len(state.T_world_rig.matrix)
    for axis in range(6):
        for kind, column in (("camera", 12 + axis), ("board", 18 + axis), ("pose", 24 + axis)):
            shared, poses = np.zeros(len(problem.is_free)), np.zeros((num_poses, 6))
            if kind == "camera":
                shared[18 * camera[0] + 12 + axis] = h
                rows = camera == camera[0]
            elif kind == "board":
                shared[18 * num_cameras + 6 * board[0] + axis] = h
                rows = board == board[0]
            else:
                poses[instant[0], axis] = h
                rows = instant == instant[0]
            change = residuals(problem, state.moved(shared, poses)) - residuals(problem, state.moved(-shared, -poses))
            np.testing.assert_allclose(change[rows] / (2 * h), J[rows, :, column], atol=2e-3)  # px per m, up to 1000


def test_board_pose_from_rays_beyond_90_degrees():
    board = Board("b", 9, 6, 0.1)
    T = SE3.exp([0.9, 0.1, -0.3, 0.2, 1.7, 0.1])
    rays = T.apply(board.points)
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    np.testing.assert_allclose(board_pose(rays, board.points).matrix, T.matrix, atol=1e-6)
    center = board.points.mean(axis=0, keepdims=True)
    np.testing.assert_allclose(other_pose(T, board.points).apply(center), T.apply(center), atol=1e-9)


def test_hand_eye_finds_two_unknown_poses(rng):
    X, Z = SE3.exp([0.3, -0.2, 0.1, 0.5, 2.0, -0.4]), SE3.exp([2.0, 1.0, 0.3, -1.0, 0.2, 0.7])
    A = SE3.exp(rng.normal(0.0, 0.4, (12, 6)))
    found_X, found_Z, rms = hand_eye(X.inverse() @ A @ Z, A, rng)
    np.testing.assert_allclose(found_X.matrix, X.matrix, atol=1e-3)
    np.testing.assert_allclose(found_Z.matrix, Z.matrix, atol=1e-3)
    assert rms < 1e-3


def test_turns_of_a_board():
    assert len(Board("b", 9, 6, 0.1).turns) == 1
    board = Board("b", 8, 6, 0.1)
    turned = board_turns(board)[1]
    np.testing.assert_allclose(turned.apply(board.points), board.points[board.turns[1]], atol=1e-9)


def test_boards_that_look_alike_are_refused():
    with pytest.raises(ValueError, match="look alike"):
        check_distinct((Board("a", 8, 6, 0.1), Board("b", 6, 8, 0.2)))
    with pytest.raises(ValueError, match="8x6"):
        parse_size("8by6")


@pytest.mark.slow
def test_rendered_corners_are_found_to_a_tenth_of_a_pixel(world):
    rng = np.random.default_rng(0)
    off = []
    for view in world.views(BoardView, 0.0, rng)[:4]:
        camera = [part.name for part in world.rig.cameras].index(view.camera)
        board = next(item for item in world.boards if item.name == view.board)
        seen = detect_all(world.render(camera, int(view.instant), rng), [board]).get(board.name)
        if seen is not None:
            truth = view.pixels[board.turns]  # of every numbering that looks alike
            off.append(min(np.sqrt(np.mean(np.sum((seen[1] - one) ** 2, axis=-1))) for one in truth))
    assert len(off) >= 2
    assert max(off) < 0.2  # noise of 2 grey levels and squares of some 15 px


@pytest.mark.slow
def test_a_right_rig_agrees_with_its_single_cameras(calibrated):
    assert not any("not the same camera" in line for line in calibrated[0].warnings)


@pytest.mark.slow
def test_images_that_were_not_taken_at_one_time_are_warned_of(world, calibrated):
    """The second camera's images are of moments at which the rig stood elsewhere, by 3 mm and 0.2 degrees."""
    _, _, specs, _ = calibrated
    rng = np.random.default_rng(8)
    shaken = SE3.exp(rng.normal(0.0, 0.003, (len(world.T_world_rig.matrix), 6)))
    late = dataclasses.replace(world, T_world_rig=world.T_world_rig @ shaken)
    views = [view for view in world.views(BoardView, 0.1, rng) if view.camera == "cam0"]
    views += [view for view in late.views(BoardView, 0.1, rng) if view.camera == "cam1"]
    found = calibrate(specs, world.boards, views, PARAMS, world.rig.cameras[0].T_rig_camera)
    lines = [line for line in found.warnings if "by itself and with the others it is not the same camera" in line]
    assert lines
    assert found.warnings[-1].startswith("were the images of each instant taken at one time")
