"""A recording of another writer, with the names of a driver: inspect tells what can be done with it, and how."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rosbags.rosbag2 import StoragePlugin
from sensor_msgs.msg import LaserScan
from tf2_msgs.msg import TFMessage

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.trajectory import read_tum
from sphere_nav.ros.conversions import array_to_image, camera_to_info, se3_to_transform
from worlds.commands import call
from worlds.copies import REALSENSE, copy_bag
from worlds.recordings import FRAME, ROOM, optical, pose, rgbd, stamp, stereo, write_bag

T_IMAGE_DEPTH = SE3.exp([-0.03, 0.005, 0.0, 0.0, 0.01, 0.0])  # of a depth camera beside the colour camera
DEPTH_CAMERA = Pinhole(212, 160, 190.0, 191.0, 104.0, 81.0)
DEPTH_FRAME = "camera_depth_optical"


def unregistered(number):
    """Yield an RGB-D camera's messages; depth is the depth camera's own, in mm, 4 ms late."""
    late = stamp(number) + 4_000_000
    yield from ((topic, message) for topic, message in rgbd(number) if topic != "depth/image_raw")
    _, meters = ROOM.rgbd(DEPTH_CAMERA, optical(pose(number)) @ T_IMAGE_DEPTH)
    pixels = np.nan_to_num(np.rint(meters * 1e3), nan=0, posinf=0).astype(np.uint16)
    yield "depth/image_raw", array_to_image(pixels, late, DEPTH_FRAME, "16UC1")
    yield "depth/camera_info", camera_to_info(DEPTH_CAMERA, late, DEPTH_FRAME)
    lens = se3_to_transform(T_IMAGE_DEPTH, stamp(number), FRAME, DEPTH_FRAME)
    yield "tf_static", TFMessage(transforms=[lens])


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    folder = tmp_path_factory.mktemp("own")
    own = {"rgbd": write_bag(folder / "rgbd", rgbd, numbers=range(4)),
           "stereo": write_bag(folder / "stereo", stereo, numbers=range(3))}  # fmt: skip
    for name, bag in own.items():
        assert call("map", bag, "-o", folder / f"{name}_map", "--taught", folder / f"{name}.tum") == 0
    return own


def test_depth_of_its_own_camera_without_frames_is_no_offer(tmp_path, capsys):
    source = write_bag(tmp_path / "source", unregistered, numbers=range(2))
    names = REALSENSE | {
        "/depth/image_raw": "/camera/camera/depth/image_rect_raw",
        "/depth/camera_info": "/camera/camera/depth/camera_info",
    }
    copy_bag(source, tmp_path / "foreign", {ours: theirs for ours, theirs in names.items() if ours != "/tf_static"})
    call("inspect", tmp_path / "foreign")
    said = capsys.readouterr().out
    assert f"map: expected {DEPTH_FRAME} and {FRAME} on /tf_static, found no way" in said
    assert "sphere_nav map" not in said


def test_a_camera_that_is_far_from_its_vehicle_is_of_no_use_until_the_user_says_where_it_sits(tmp_path, capsys):
    def far(number):
        yield from ((topic, message) for topic, message in rgbd(number) if topic != "tf_static")
        place = se3_to_transform(SE3.exp([400.0, 0.0, 1100.0, 0, 0, 0]), stamp(number), "base_link", FRAME)
        yield "tf_static", TFMessage(transforms=[place])

    bag = write_bag(tmp_path / "far", far, numbers=range(2))
    assert call("inspect", bag) == 1
    assert f"image_raw ({FRAME}: expected metres, 0 to 25, found 1170: millimetres?" in capsys.readouterr().out
    assert call("inspect", bag, "--mounting", "0.4,0,1.1,0,0,0") == 0


def test_a_frame_that_is_told_at_two_places_and_a_scan_in_mm_are_named(tmp_path, capsys):
    def contradicting(number):
        yield from rgbd(number)
        scan = LaserScan(angle_max=3.0, angle_increment=1.0, range_max=3e4, ranges=[3500.0] * 4)
        scan.header.stamp = Time(sec=stamp(number) // 10**9)
        yield "scan", scan
        place = se3_to_transform(SE3.exp([0.2 + number, 0, 0, 0, 0, 0]), stamp(number), "base_link", "mast")
        yield "tf_static", TFMessage(transforms=[place])

    assert call("inspect", write_bag(tmp_path / "two", contradicting, numbers=range(2))) == 0
    said = capsys.readouterr().out
    assert "/tf_static: transform base_link -> mast: told twice, 1.000 m and 0.0 deg apart: the later one holds" in said
    assert "scan: ranges: median: expected metres, 0.01 to 200, found 3500: millimetres? (factor 0.001)" in said


@pytest.mark.slow
def test_a_driver_a_mounting_and_no_frames_at_all_map_and_localize(own, tmp_path, capsys):
    """A folder with a database alone, a camera called otherwise, no /tf_static: nothing but the options tells it."""
    names = {
        ours: theirs.replace("/camera/camera", "/front") for ours, theirs in REALSENSE.items() if ours != "/tf_static"
    }
    bag = copy_bag(own["rgbd"], tmp_path / "foreign", names, storage=StoragePlugin.SQLITE3)
    (bag / "metadata.yaml").unlink()
    words = ("--driver", "realsense", "--mounting", "0.4,0,1.1,0,0,0")
    assert call("map", bag, "-o", tmp_path / "m", "--taught", tmp_path / "taught.tum", *words) == 0
    assert (tmp_path / "taught.tum").read_text() == own["rgbd"].with_suffix(".tum").read_text()
    capsys.readouterr()
    assert call("localize", tmp_path / "m", bag, "-o", tmp_path / "p.tum", "--driver", "realsense") == 0
    assert "camera is taken as the vehicle" in capsys.readouterr().err
    assert call("localize", tmp_path / "m", bag, "-o", tmp_path / "q.tum", *words) == 0
    assert "taken as the vehicle" not in capsys.readouterr().err
    ours, mounted = (read_tum(tmp_path / name).T_map_body for name in ("p.tum", "q.tum"))
    camera = mounted @ SE3.from_parts(np.eye(3), [0.4, 0.0, 1.1])
    # Who knows the mounting knows the ground, too, which moves a pose by some hundredths of a millimetre.
    np.testing.assert_allclose(camera.translation, ours.translation, atol=1e-4)
