"""`sphere_nav calibrate`: from rendered images to rig file, report and picture; what it refuses."""

import json

import cv2
import numpy as np
import pytest

from rig_calibration.boards.board import Board
from sphere_nav.geometry import SE3, Pinhole, Rig, RigCamera, so3
from sphere_nav.geometry.cameras.rig import T_BODY_OPTICAL
from sphere_nav.geometry.files.rig_file import read_rig
from sphere_nav_tools.cli.calibrate import find_images
from sphere_nav_tools.cli.main import main
from worlds.boards import BoardWorld

NUM_INSTANTS = 12
BOARD = Board("board", 7, 4, 0.1)
CAMERA = Pinhole(400, 300, 260.0, 261.0, 198.0, 152.0, (-0.1, 0.02, 0.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def world():
    """A stereo pair, 0.2 m wide, that is tilted and moved before one board."""
    rng = np.random.default_rng(8)
    right = SE3.exp([0.0, -0.2, 0.0, 0.01, -0.02, 0.01]) @ T_BODY_OPTICAL
    rig = Rig((RigCamera("left", CAMERA, T_BODY_OPTICAL), RigCamera("right", CAMERA, right)))
    R = T_BODY_OPTICAL.rotation
    board = SE3.from_parts(R, [1.1, -0.1, 0.0] - R @ BOARD.points.mean(axis=0))
    poses = []
    for _ in range(NUM_INSTANTS):
        turn = so3.exp([*rng.uniform(-0.35, 0.35, 2), 0.0])
        about_board = SE3.from_parts(np.eye(3), [1.1, 0.0, 0.0])  # the board stays in view
        shift = SE3.from_parts(np.eye(3), [-1.1 + rng.uniform(-0.1, 0.15), *rng.uniform(-0.12, 0.12, 2)])
        poses.append((about_board @ SE3.from_parts(turn, np.zeros(3)) @ shift).matrix)
    return BoardWorld(rig, (BOARD,), SE3(board.matrix[None]), SE3(np.stack(poses)))


@pytest.fixture(scope="module")
def folders(world, tmp_path_factory):
    root, rng = tmp_path_factory.mktemp("images"), np.random.default_rng(9)
    for camera, part in enumerate(world.rig.cameras):
        (root / part.name).mkdir()
        for instant in range(NUM_INSTANTS):
            cv2.imwrite(str(root / part.name / f"{instant:02d}.png"), world.render(camera, instant, rng))
    return [root / part.name for part in world.rig.cameras]


def calibrate(capsys, *words):
    status = main(["calibrate", *map(str, words)])
    out, err = capsys.readouterr()
    return status, out.splitlines(), [line for line in err.splitlines() if line.startswith("sphere_nav")]


@pytest.mark.slow
def test_images_become_a_rig_file_with_report(capsys, world, folders, tmp_path):
    boards = tmp_path / "boards.yaml"
    boards.write_text("wall: {size: 7x4, square: 0.1}\n")
    path = tmp_path / "rig.yaml"
    status, out, err = calibrate(capsys, *folders, "--boards", boards, "-o", path)
    assert (status, err) == (0, [])
    assert out[0].startswith("left: RMS 0.")
    rig = read_rig(path)
    assert rig.names == ("left", "right")
    # 24 images of 400 x 300 with 28 corners at some 0.05 px: the report promises about 1 mm and 0.1 degrees
    position, angle = rig.cameras[1].T_rig_camera.distance(world.rig.cameras[1].T_rig_camera)
    assert position < 0.004
    assert np.degrees(angle) < 0.4
    assert rig.cameras[0].camera.fx == pytest.approx(CAMERA.fx, rel=0.01)
    report = json.loads((tmp_path / "rig_report.json").read_text())
    right = report["cameras"]["right"]
    assert right["rms_px"] < 0.2
    assert right["held_out_rms_px"] < 0.3
    assert max(right["position_std_mm"]) < 4.0
    assert {line.split(": ")[1] for line in report["warnings"]} == {"one side only"}  # of both, 25 % of one half
    picture = cv2.imread(str(tmp_path / "rig_report.png"))
    assert picture.shape[0] > 400
    assert picture.std() > 10.0  # something is drawn


def test_cameras_are_named_by_their_folder_or_by_what_their_files_begin_with(tmp_path):
    for name in ("front cam/1.png", "front cam/2.PNG", "left_1.png", "left_2.png", "7.png", "8.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"")
    found = find_images([str(tmp_path / "front cam"), str(tmp_path / "left_*.png"), str(tmp_path / "[78].png")])
    folder = "".join(letter if letter.isalnum() else "_" for letter in tmp_path.name)
    assert list(found) == ["front_cam", "left", folder]
    assert [len(files) for files in found.values()] == [2, 2, 2]
    assert find_images([str(tmp_path / "7.png")])[folder] == {"7": tmp_path / "7.png"}


def test_a_video_is_images_spread_over_it_by_their_number(tmp_path):
    video = cv2.VideoWriter(str(tmp_path / "my board.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 30.0, (64, 48))
    for number in range(200):
        video.write(np.full((48, 64, 3), number, np.uint8))
    video.release()
    images = find_images([str(tmp_path / "my board.avi")])["my_board"]
    assert len(images) == 80
    assert [*images][:2] + [*images][-1:] == ["000000", "000003", "000199"]
    levels = [float(image.mean()) for image in images.values()]
    np.testing.assert_allclose(levels, [int(number) for number in images], atol=2.0)
    assert {image.shape for image in images.values()} == {(48, 64)}
