"""`sphere_nav refine-camera`: a drive tells the lens, and where the camera sits."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from rig_calibration.drive.drive_lens import Lens
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.geometry.cameras.rig import T_BODY_OPTICAL
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.ros.bags.writer import BagWriter
from sphere_nav.ros.camera.mounting import read_mounting
from sphere_nav.ros.conversions import array_to_image, camera_to_info, se3_to_odometry
from sphere_nav.ros.maps.reader import save_map
from sphere_nav.ros.tf import TransformTree
from sphere_nav_tools.cli import refine_camera
from sphere_nav_tools.cli.main import main
from sphere_nav_tools.cli.refine_camera import RecordedDrive, mounting_by_odometry, mounting_lines, mounting_values
from sphere_nav_tools.offline.evaluation import trajectory_of
from worlds.localizer import STEP_NS, at, make_map
from worlds.room import wide_room

START_NS = 1_000_000_000
CAMERA = Pinhole(200, 150, 140.0, 140.5, 101.0, 73.0, (-0.06, 0.01, 0.0, 0.0))
GUESS = replace(CAMERA, fx=147.0, fy=147.0, cx=99.5, cy=74.5, distortion=())  # 5 % off
READOUT_S = 0.03
NUM_IMAGES = 16
TUNED = ["--set", "acceptance.min_pixels=200", "--set", "alignment.num_levels=4", "--images", "8"]


def pose(t):
    """A camera that sways, nods and rolls while it moves ahead."""
    turn = SE3.exp([0.0, 0.0, 0.0, 0.12 * np.sin(5 * t), 0.2 * np.sin(4 * t + 1), 0.1 * np.sin(6 * t + 2)])
    return at(-1.6 + 0.8 * t, 0.2 * np.sin(2 * t), 0.5 * t) @ turn


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder, room = tmp_path_factory.mktemp("refine"), wide_room()
    places = [SE3.from_planar(x, 0.0, 0.0) for x in (-1.8, -1.0)]
    save_map(folder / "map", make_map(room, places, Spherical(1024, 512)).graph)
    with BagWriter(folder / "bag") as bag:
        rng = np.random.default_rng(3)
        for k in range(NUM_IMAGES):
            stamp, t = START_NS + k * STEP_NS, k * STEP_NS * 1e-9
            twist = (pose(t - 1e-3).inverse() @ pose(t + 1e-3)).log() * READOUT_S / 2e-3
            gray = room.render_rolling(CAMERA, pose(t), twist) + rng.normal(0, 2.0, (CAMERA.height, CAMERA.width))
            image = np.clip(np.rint(gray), 1, 255).astype(np.uint8)
            bag.write("/camera_info", camera_to_info(GUESS, stamp, "optical"), stamp)
            bag.write("/image_raw", array_to_image(image, stamp, "optical", "mono8"), stamp)
    return folder


@pytest.mark.slow
def test_a_guess_becomes_a_calibration(recorded, tmp_path, capsys):
    output = tmp_path / "camera.yaml"
    assert main(["refine-camera", str(recorded / "map"), str(recorded / "bag"), "-o", str(output), *TUNED]) == 0
    found = yaml.safe_load(output.read_text())
    fx, _, cx, _, fy, cy, *_ = found["camera_matrix"]["data"]
    assert (fx, fy) == pytest.approx((CAMERA.fx, CAMERA.fy), rel=0.003)
    assert (cx, cy) == pytest.approx((CAMERA.cx, CAMERA.cy), abs=0.5)
    assert found["readout"] == pytest.approx(READOUT_S, rel=0.1)
    assert set(found["standard_deviations"]) == {"fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "readout"}
    printed = capsys.readouterr().out
    assert "NOT OBSERVED" not in printed
    assert "no mounting: the bag has no odometry" in printed


@pytest.mark.parametrize(("change_px", "num_rounds"), [(1.9, 1), (2.1, 3)])
def test_a_drive_is_localised_anew_while_the_lens_changes_by_two_pixels(monkeypatch, change_px, num_rounds):
    lenses, recorded = [], SimpleNamespace(camera=CAMERA, patience={})
    closed = SimpleNamespace(close=lambda: None)
    for name, value in {
        "RecordedCamera": lambda *_: recorded,
        "refine_camera": lambda *_, **__: SimpleNamespace(lens=Lens(GUESS, 0.01 * len(lenses))),
        "lens_distance": lambda a, b: change_px,
        "prove": lambda *_, **__: None,
        "Localizer": lambda params, _: lenses.append(params.camera) or SimpleNamespace(references=closed),
    }.items():
        monkeypatch.setattr(refine_camera, name, value)
    monkeypatch.setattr(
        RecordedDrive, "_localize", lambda *_: Trajectory(np.empty(0, np.int64), SE3(np.empty((0, 4, 4))))
    )
    monkeypatch.setattr(RecordedDrive, "_collect", lambda *_: ())
    RecordedDrive(SimpleNamespace(source="", settings={})).refine(None)
    assert [lens.readout for lens in lenses] == [0.01 * k for k in range(num_rounds)]


PERIOD_NS = 50_000_000
T_BASE_CAMERA = SE3.from_angles(0.02, 0.1, 0.4, [0.6, -0.1, 1.1])


def drive(folder, count):
    """A bag with the odometry of a vehicle that weaves, and its camera's poses between those messages."""
    T_odom_base, poses = SE3.identity(), []
    with BagWriter(folder) as bag:
        for k in range(count):
            step = SE3.exp([0.04, 0.0, 0.0, 0.0, 0.0, 0.02 * np.sin(0.05 * k)])
            stamp = 1_000_000_000 + k * PERIOD_NS
            message = se3_to_odometry(T_odom_base, np.zeros((6, 6)), stamp, ("odom", "base_link"))
            bag.write("/wheels", message, stamp)
            between = T_odom_base @ SE3.exp(0.5 * step.log())
            poses.append(SE3.from_planar(5.0, 1.0, 0.7) @ between @ T_BASE_CAMERA @ T_BODY_OPTICAL)
            T_odom_base = T_odom_base @ step
    stamps = 1_000_000_000 + PERIOD_NS // 2 + PERIOD_NS * np.arange(count)
    return trajectory_of(stamps, poses)


def mounting_of(folder, mounting, camera):
    recorded = SimpleNamespace(odometry="/wheels", frame_id="optical", frames=TransformTree())
    return mounting_by_odometry(SimpleNamespace(source=folder, mounting=mounting), recorded, camera)


def test_a_camera_is_mounted_where_odometry_finds_it(tmp_path):
    camera = drive(tmp_path / "bag", 400)
    found, _ = mounting_of(tmp_path / "bag", "0.5,0,1.1,0,0,0", camera)
    assert found.unobserved == ("z",)
    assert found.values[:6] == pytest.approx([0.6, -0.1, 1.1, 0.02, 0.1, 0.4], abs=2e-3)
    assert next(line for line in mounting_lines(found) if "NOT OBSERVED" in line).startswith("z ")
    path = tmp_path / "camera.yaml"
    path.write_text(yaml.safe_dump({"camera_name": "front"} | mounting_values(found)))
    assert read_mounting(str(path)).matrix == pytest.approx(found.T_base_camera.matrix, abs=1e-9)


def test_a_drive_that_is_too_short_says_so(tmp_path):
    found, reason = mounting_of(tmp_path / "bag", "", drive(tmp_path / "bag", 40))
    assert found is None
    assert reason == "expected a drive of at least 8 pieces of 1 m or 17 deg, found 1"
