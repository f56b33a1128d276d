"""`sphere_nav refine-camera BAG`: an RGB-D drive tells where its depth camera sits; `map` warns, and maps with it."""

import numpy as np
import pytest
import yaml

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.ros.camera.mounting import read_mounting
from sphere_nav.ros.conversions import array_to_image, camera_to_info
from sphere_nav_tools.cli.main import main
from worlds.recordings import FRAME, stamp, stereo, write_bag
from worlds.room import optical, sharp_room

pytestmark = pytest.mark.slow

CAMERA = Pinhole(240, 180, 190.0, 190.0, 119.5, 89.5)
ROOM = sharp_room((2.0, 1.6, 1.2), 0.2)
T_IMAGE_DEPTH = SE3.exp([-0.016, 0.006, -0.01, 0.010, -0.011, 0.009])  # 20 mm, 1 deg
NUM_FRAMES = 18


def way(number):
    """A camera that sways while it moves ahead and turns."""
    t = 0.5 * number
    turn = [0.0, 0.0, 0.0, 0.08 * np.sin(1.3 * t), 0.06 * np.sin(1.7 * t + 1), 0.15 * t]
    return SE3.exp([-0.6 + 0.12 * t, 0.3 * np.sin(t), 0.25 * np.cos(1.4 * t), 0.0, 0.0, 0.0]) @ SE3.exp(turn)


def rgbd(T_image_depth, place=way):
    """Image and depth of a camera whose depth is said to be registered to the image."""

    def instant(number):
        T_room_camera = optical(place(number))
        _, range_m = ROOM.render(CAMERA, T_room_camera @ T_image_depth)
        depth_m = (range_m * CAMERA.unproject(pixel_grid(CAMERA))[..., 2]).astype(np.float32)
        yield "camera_info", camera_to_info(CAMERA, stamp(number), FRAME)
        yield "depth/image_raw", array_to_image(depth_m, stamp(number), FRAME, "32FC1")
        image = ROOM.photograph(CAMERA, T_room_camera, number)
        yield "image_raw", array_to_image(image, stamp(number), FRAME, "mono8")

    return instant


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp("depth")
    return {
        "wrong": write_bag(folder / "wrong", rgbd(T_IMAGE_DEPTH), numbers=range(NUM_FRAMES)),
        "still": write_bag(folder / "still", rgbd(SE3.identity(), lambda _: way(0)), numbers=range(3)),
        "stereo": write_bag(folder / "stereo", stereo, numbers=range(2)),
    }


def call(*words):
    return main([str(word) for word in words])


def test_a_wrong_pose_is_named_found_and_mapped_with(bags, tmp_path, capsys):
    assert call("map", bags["wrong"], "-o", tmp_path / "bent") == 0
    assert "depth camera: this drive places it elsewhere" in capsys.readouterr().out
    output = tmp_path / "depth.yaml"
    assert call("refine-camera", bags["wrong"], "-o", output) == 0
    assert "NOT OBSERVED" not in capsys.readouterr().out
    off = read_mounting(str(output), "depth_pose").distance(T_IMAGE_DEPTH)
    assert off[0] < 0.01  # deviations are 2 to 5 mm, 0.05 deg
    assert off[1] < np.radians(0.2)
    assert set(yaml.safe_load(output.read_text())["standard_deviations"]) == {"x", "y", "z", "roll", "pitch", "yaw"}
    assert call("map", bags["wrong"], "-o", tmp_path / "straight", "--set", f"depth_pose={output}") == 0
    assert "depth camera" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("still", "expected at least 8 pairs of images with motion between, found 0"),
        ("stereo", "expected images with depth where no MAP is given, found stereo"),
    ],
)
def test_what_tells_nothing_is_one_line_and_nothing_is_written(name, message, bags, tmp_path, capsys):
    assert call("refine-camera", bags[name], "-o", tmp_path / "depth.yaml") == 2
    error = capsys.readouterr().err.strip()
    assert message in error
    assert "\n" not in error
    assert not (tmp_path / "depth.yaml").exists()
