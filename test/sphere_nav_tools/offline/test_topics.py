"""The options that name topics, and what is offered for a recording; the commands are carried out in the zoo."""

import argparse
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.streams import ODOMETRY, SPHERE_INFO, Stream
from sphere_nav.ros.conversions import header, se3_to_transform
from sphere_nav.ros.tf import TransformTree
from sphere_nav_tools.cli.bags import inspect_
from sphere_nav_tools.cli.bags.inspect_ import find_offer, odometry_of
from sphere_nav_tools.offline.topics import add_options, camera_names, options_of
from worlds.streams import camera, finder_of, image


def parse(*words):
    parser = argparse.ArgumentParser()
    add_options(parser)
    return parser.parse_args(words)


def test_options_name_our_topics():
    words = ("--image", "/a", "--depth-info", "/b", "--camera", "front=/c", "--remap", "/tf:=/d")
    assert parse(*words).topics == {
        "image_raw": "/a",
        "depth/camera_info": "/b",
        "cameras/front/image_raw": "/c",
        "tf": "/d",
    }
    with pytest.raises(ValueError, match=r"--remap: expected one of our topics .*, found 'imu/data': nobody reads it"):
        parse("--remap", "/imu/data:=/d")


def test_what_is_told_is_what_is_understood():
    topics = {"image_raw": "/a", "camera_info": "/camera_info", "cameras/x/image_raw": "/y"}
    words = options_of(topics)
    assert "/camera_info" not in words
    assert parse(*words).topics == {"image_raw": "/a", "cameras/x/image_raw": "/y"}
    assert camera_names(topics) == ["x"]


SECOND = 10**9
NAMES = ("front", "left", "right")
CAMERAS = [camera(f"/{name}/image_raw", "mono8", name) for name in NAMES]
RIG = [images for images, _ in CAMERAS]
CALIBRATED = [stream for pair in CAMERAS for stream in pair]
RIG_LINK = ("base_link", "rig_link")
ODOM = Stream("/wheel/odom", ODOMETRY, 90, 50.0, "odom")


def frames(*edges, is_static=True):
    tree = TransformTree()
    for parent, child in edges:
        for stamp in (SECOND, 2 * SECOND):
            tree.add(
                se3_to_transform(SE3.from_parts(np.eye(3), [0, 0, 1.0]), stamp, parent, child), is_static=is_static
            )
    return tree


MOUNTED = frames(*(("base_link", name) for name in NAMES))


def test_a_rig_is_mapped_by_the_names_of_its_cameras():
    found = find_offer("map", finder_of(RIG))
    assert found.command[-5:] == ["--rig", "rig.yaml", *(f"--camera={name}=/{name}/image_raw" for name in NAMES)]
    assert "that has these names" in found.note


def test_a_rig_file_says_which_cameras_there_are(monkeypatch):
    monkeypatch.setattr(inspect_, "read_rig", lambda path: SimpleNamespace(names=("left", "top")))
    found = find_offer("map", finder_of(RIG[1:2]), Path("six.yaml"))
    assert found.command[-3:] == ["--rig", "six.yaml", "--camera=left=/left/image_raw"]
    assert found.note.endswith("without top")
    assert find_offer("map", finder_of([]), Path("six.yaml")).missing.startswith(
        "expected images of camera left (--camera left=TOPIC)"
    )


def test_several_cameras_localize_by_the_map_of_their_rig_or_by_their_own_calibrations():
    unmounted, mounted = (
        find_offer("localize", finder_of(RIG, tree=tree)).command for tree in (frames(), frames(RIG_LINK))
    )
    assert "rig.calibration=map" in mounted
    assert "--mounting" not in mounted
    assert unmounted == [*mounted, "--mounting", "0,0,0,0,0,0"]
    told = find_offer("localize", finder_of(CALIBRATED, tree=MOUNTED))
    assert told.note == "ready, by 3 cameras"
    assert "rig.calibration=map" not in told.command
    assert "choose by --image" in find_offer("localize", finder_of(CALIBRATED)).missing
    assert "choose by --image" in find_offer("localize", finder_of(RIG[:2])).missing


def test_bare_geometry_needs_the_height_of_the_camera_and_names_odometry_that_is_missing():
    one = CAMERAS[0]
    assert find_offer("mcl", finder_of([*one, ODOM], tree=MOUNTED)).command[:3] == ["sphere_nav", "mcl", "CLOUD"]
    alone = find_offer("mcl", finder_of(one, tree=MOUNTED))
    assert alone.command[:3] == ["sphere_nav", "mcl", "CLOUD"]
    assert alone.note.startswith("ready; no place is trusted without odometry (nav_msgs/Odometry, or")
    assert "odometry" not in find_offer("mcl", finder_of([*one, ODOM], tree=MOUNTED)).note
    assert "base_link and front on /tf_static, or the height" in find_offer("mcl", finder_of([*one, ODOM])).missing
    assert find_offer("mcl", finder_of([*one, ODOM], mounting="0,0,1,0,0,0")).command
    moving = frames(("odom", "base_link"), is_static=False)
    flat = find_offer("mcl", finder_of(one, mounting="0,0,0.04,0,0,0")).missing
    assert "height of the camera above base_link" in flat
    assert "found 0.04 m" in flat
    moving.add(se3_to_transform(SE3.exp([0, 0, 0.06, 0, 0, 0]), SECOND, "base_link", "front"), is_static=True)
    assert find_offer("mcl", finder_of(one, tree=moving)).command
    assert odometry_of(finder_of(one, tree=moving)) == "/tf (odom to base_link)"


def test_a_panorama_is_offered_with_what_it_needs():
    for info, words in [
        ([Stream("/theta/sphere_info", SPHERE_INFO, 9, 30.0, "front")], ["--remap", "sphere_info:=/theta/sphere_info"]),
        ([], ["--set", "is_panorama=true"]),
    ]:
        images = image("/theta/image_raw", frame="front", size=(256, 128))
        for job in ("localize", "mcl"):
            found = find_offer(job, finder_of([images, *info, ODOM], tree=MOUNTED))
            assert found.command[-2:] == words
            assert ("whole spheres" in found.note) == (not info)
        assert find_offer("localize", finder_of(RIG[:1])).missing  # no panorama: not twice as wide as high


@pytest.mark.parametrize(("late_ms", "slack_s"), [(10, None), (11, None), (250, 0.3)])
def test_images_of_different_instants_are_no_pair(late_ms, slack_s):
    """The stamps of 30 Hz may be 11 ms apart, or as much as the user says."""
    stamps = [(topic, k * SECOND + late) for k in range(50) for topic, late in (("/a", 0), ("/b", late_ms * 1_000_100))]
    finder = finder_of([image("/a")])
    finder.bag.messages = lambda _: ((t, 0, SimpleNamespace(header=header(ns, ""))) for t, ns in stamps)
    refusal = pytest.raises(BagError, match=r"/b: expected stamps within 11 ms of /a .*, found 11 ms at the nearest")
    with refusal if late_ms == 11 else nullcontext():
        finder.check_stamps("/a", "/b", slack_s)
