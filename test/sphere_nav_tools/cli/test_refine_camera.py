"""`sphere_nav refine-camera`: a drive in a map tells the lens."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from sensor_msgs.msg import CameraInfo, Image

from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.ros import qos
from sphere_nav.ros.bags.writer import BagWriter
from sphere_nav.ros.conversions import array_to_image, camera_to_info
from sphere_nav.ros.maps.reader import save_map
from sphere_nav_tools.cli.main import main
from worlds.localizer import STEP_NS, at, make_map
from worlds.room import wide_room

pytestmark = pytest.mark.slow

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
        bag.add_topic("/camera_info", CameraInfo, qos.STATE)
        bag.add_topic("/image_raw", Image, qos.STATE)
        rng = np.random.default_rng(3)
        for k in range(NUM_IMAGES):
            stamp, t = START_NS + k * STEP_NS, k * STEP_NS * 1e-9
            twist = (pose(t - 1e-3).inverse() @ pose(t + 1e-3)).log() * READOUT_S / 2e-3
            gray = room.render_rolling(CAMERA, pose(t), twist) + rng.normal(0, 2.0, (CAMERA.height, CAMERA.width))
            image = np.clip(np.rint(gray), 1, 255).astype(np.uint8)
            bag.write("/camera_info", camera_to_info(GUESS, stamp, "optical"), stamp)
            bag.write("/image_raw", array_to_image(image, stamp, "optical", "mono8"), stamp)
    return folder


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


def test_what_is_not_proved_is_not_written(recorded, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("rig_calibration.drive.proof.FALSE_ALARM", 1e-30)  # no evidence is enough
    monkeypatch.setattr("sphere_nav_tools.offline.refine_camera.REFINE_ROUNDS", 1)
    output = tmp_path / "camera.yaml"
    words = ["refine-camera", str(recorded / "map"), str(recorded / "bag"), "-o", str(output), *TUNED]
    assert main(words) == 1
    assert not output.exists()
    printed = capsys.readouterr().out
    assert "refused, nothing is written" in printed
    assert "held-out images: expected" in printed
