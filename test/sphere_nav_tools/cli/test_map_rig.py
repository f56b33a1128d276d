"""`sphere_nav map --rig`: a bag with the images of six cameras becomes a map; what does not fit is one line."""

import dataclasses

import numpy as np
import pytest
from tf2_msgs.msg import TFMessage

from cycab_sim.params import SimParams
from cycab_sim.sensors.cameras import rig_place
from cycab_sim.simulator import Simulator
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav.geometry.trajectory import read_tum
from sphere_nav.params import build
from sphere_nav.ros.bags import BagWriter
from sphere_nav.ros.conversions import array_to_image, se3_to_odometry, se3_to_transform
from sphere_nav.ros.maps.reader import open_map
from worlds.commands import call
from worlds.rig import seen, vertical_rig

START, STEP = 1_000_000_000, 100_000_000
SETTINGS = ("--set-stitcher", "stitch.width=256")
NUM_INSTANTS = 3
WAY = 0.3  # m between them


def write_images(bag, images, stamp):
    for name, image in images.items():
        encoding = "rgb8" if image.ndim == 3 else "mono8"
        bag.write(f"cameras/{name}/image_raw", array_to_image(image, stamp, f"{name}_optical", encoding), stamp)


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """A short way straight on through the simulator's town, seen by the vertical rig."""
    folder = tmp_path_factory.mktemp("drive")
    values = {"seed": 5, "rig.kind": "vertical", "rig.size": "192,192", "render.shadow_texel": 0.5}
    simulator = Simulator(build(SimParams, values))
    write_rig(folder / "rig.yaml", simulator.rig)
    T_base_rig = rig_place(simulator.params.rig)
    x, y, _ = simulator.vehicle.state.T_world_base.translation
    yaw = float(simulator.vehicle.state.T_world_base.yaw)
    with BagWriter(folder / "bag") as bag:
        mount = se3_to_transform(T_base_rig, START, "base_link", "rig_link")
        bag.write("/tf_static", TFMessage(transforms=[mount]), START)
        for number in range(NUM_INSTANTS):
            stamp = START + number * STEP
            simulator.teleport(float(x + number * WAY * np.cos(yaw)), float(y + number * WAY * np.sin(yaw)), yaw)
            T_world_base = simulator.vehicle.state.T_world_base
            message = se3_to_odometry(T_world_base, np.zeros((6, 6)), stamp, ("world", "base_link"))
            bag.write("ground_truth/odometry", message, stamp)
            write_images(bag, {name: frame.image for name, frame in simulator.capture_rig().items()}, stamp)
    return folder


@pytest.mark.slow
def test_a_drive_of_six_cameras_is_mapped(drive, tmp_path, capsys):
    words = ("map", drive / "bag", "-o", tmp_path / "m", "--rig", drive / "rig.yaml", "--anchor", "truth", *SETTINGS)
    assert call(*words, "--taught", tmp_path / "t.tum") == 0
    assert f"{NUM_INSTANTS} spheres placed, 0 lost" in capsys.readouterr().out
    way = read_tum(tmp_path / "t.tum").distances[-1]
    # a pixel is 1.4 degrees, of walls about 5 m away 120 mm; a tenth of that each step would be good
    assert way == pytest.approx((NUM_INSTANTS - 1) * WAY, abs=0.06)
    with open_map(tmp_path / "m") as reader:
        sphere = reader.load_sphere(0)
        assert sphere.image.shape == (128, 256, 3)
        assert 0.15 < sphere.measured.mean() < 1.0
        assert 1.0 < np.median(sphere.range_m[sphere.measured]) < 30.0


@pytest.fixture
def scene(tmp_path):
    """One instant of another rig, and its file."""
    rig = vertical_rig()
    write_rig(tmp_path / "rig.yaml", rig)
    with BagWriter(tmp_path / "bag") as bag:
        write_images(bag, {part.name: seen(part) for part in rig.cameras}, START)
    return tmp_path


def test_a_bag_of_other_cameras_is_one_line(scene, capsys):
    rig = vertical_rig()
    parts = tuple(dataclasses.replace(part, name=f"roof_{part.name}") for part in rig.cameras)
    write_rig(scene / "other.yaml", dataclasses.replace(rig, cameras=parts))
    assert call("map", scene / "bag", "-o", scene / "m", "--rig", scene / "other.yaml") == 2
    assert "topics: expected images of camera roof_top_front (--camera roof_top_front=TOPIC)" in capsys.readouterr().err
