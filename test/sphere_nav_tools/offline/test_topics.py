"""The options that name topics, and what is offered for a recording."""

import argparse
import importlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.samples import ODOMETRY, SPHERE_INFO
from sphere_nav.ros.bags.streams import CAMERA_INFO, IMAGE, RGBD, STEREO, Stream
from sphere_nav.ros.camera.drivers import driver_names, read_driver
from sphere_nav.ros.conversions import se3_to_transform
from sphere_nav.ros.tf import TransformTree
from sphere_nav_tools.cli.main import COMMANDS
from sphere_nav_tools.offline import offers, topics
from sphere_nav_tools.offline.offers import OpenedBag, offer_localize, offer_map, offer_mcl
from sphere_nav_tools.offline.topics import (
    OPTIONS,
    add_options,
    chosen_topics,
    find_drivers,
    find_lens_topics,
    find_wanted,
    names_of_cameras,
    options_of,
)


def parse(*words):
    parser = argparse.ArgumentParser()
    add_options(parser)
    return parser.parse_args(words)


def test_options_name_our_topics():
    words = ("--image", "/a", "--depth-info", "/b", "--camera", "front=/c", "--remap", "/imu/data:=/d")
    assert chosen_topics(parse(*words)) == {
        "image_raw": "/a",
        "depth/camera_info": "/b",
        "cameras/front/image_raw": "/c",
        "imu/data": "/d",
    }


def test_a_word_that_is_no_pair_is_refused():
    for words in [("--camera", "front"), ("--remap", "a=b"), ("--camera", "=/a")]:
        with pytest.raises(ValueError, match="expected A"):
            chosen_topics(parse(*words))


READERS = {"inspect", "map", "localize", "mcl", "register", "refine-camera"}  # they use topics by their meaning


def options_of_command(name):
    module = next(command.module for command in COMMANDS if command.name == name)
    parser = argparse.ArgumentParser()
    importlib.import_module(f"sphere_nav_tools.cli.{module}").add_arguments(parser)
    return {word for action in parser._actions for word in action.option_strings}


def test_every_command_that_reads_a_bag_takes_the_same_options():
    for name in sorted(READERS):
        words = {f"--{option.replace('_', '-')}" for option in OPTIONS} | {
            "--remap",
            "--camera",
            "--driver",
            "--mounting",
        }
        assert words <= options_of_command(name)


def streams_of(driver, root=None, skip=()):
    """Return what a driver publishes, depth of its own camera in a frame of its own."""
    found = []
    for ours, topic in driver.names(root).items():
        frame = "depth" if ours.startswith("depth") and "depth/camera_info" in driver.topics else ours.split("/")[0]
        frame = frame if "/" in ours and frame != "depth" else "depth_optical" if frame == "depth" else "optical"
        registered = ours == "depth/image_raw" and "depth/camera_info" not in driver.topics
        frame = "optical" if registered else frame
        kind = CAMERA_INFO if ours.endswith("camera_info") else IMAGE if ours.endswith("image_raw") else "other"
        encoding = driver.encodings.get(ours, ("",))[0]
        if ours not in skip:
            found.append(Stream("/" + topic, kind, 10, 30.0, frame, 640, 480, encoding))
    return found


def test_a_driver_publishes_the_topics_of_its_preset():
    for name in driver_names():
        driver = read_driver(name)
        kinds = {"rgbd": RGBD, "stereo": STEREO, "mono": ("image_raw", "camera_info"), "panorama": ("image_raw",)}
        wanted = kinds[driver.input]
        streams = streams_of(driver)
        found = find_wanted(streams, wanted, {})
        assert found == {ours: f"/{topic}" for ours, topic in driver.names().items() if ours in found}
        assert set(wanted) <= set(found)
        if driver.root:
            assert driver.name in [known.name for known in find_drivers(streams)]


def test_registered_depth_goes_before_depth_as_it_is_measured():
    streams = {s.topic: s for name in ("realsense_depth", "realsense") for s in streams_of(read_driver(name))}
    assert [driver.name for driver in find_drivers(list(streams.values()))] == ["realsense", "realsense_depth"]
    found = find_wanted(list(streams.values()), RGBD, {})
    assert found["depth/image_raw"] == "/camera/camera/aligned_depth_to_color/image_raw"


def test_several_sizes_of_one_camera_are_told_apart_by_the_driver_alone():
    kinect = read_driver("kinect2")
    small = [
        Stream(s.topic.replace("qhd", "sd"), s.type, 10, 30.0, "ir", 320, 240, s.encoding) for s in streams_of(kinect)
    ]
    found = find_wanted([*streams_of(kinect), *small], RGBD, {})
    assert found["image_raw"] == "/kinect2/qhd/image_color_rect"
    other = [
        Stream(s.topic.replace("kinect2", "k"), *list(vars(s).values())[1:]) for s in [*streams_of(kinect), *small]
    ]
    with pytest.raises(BagError, match="choose by --image, --depth"):
        find_wanted(other, RGBD, {})


def view(topic):
    return Stream(topic, IMAGE, 10, 30.0, topic, 64, 48, "mono8")


def test_cameras_are_called_by_what_their_topics_differ_in():
    for told, names in [
        (("/front/image_raw", "/rear/image_raw"), ["front", "rear"]),
        (("/car/cam_front/raw", "/car/cam_rear/raw"), ["cam_front", "cam_rear"]),
        (("/a/left/image", "/a/right/image", "/b/left/image"), ["a_left", "a_right", "b_left"]),
    ]:
        assert names_of_cameras([view(topic) for topic in told]) == names


def test_a_panorama_is_found_with_what_tells_its_lens():
    streams = [
        Stream("/theta/image_raw", IMAGE, 9, 30.0, "theta", 256, 128, "rgb8"),
        Stream("/theta/sphere_info", SPHERE_INFO, 9, 30.0, "theta"),
        Stream("/other/sphere_info", SPHERE_INFO, 9, 30.0, "other"),
    ]
    found = find_lens_topics(streams, lambda wanted: find_wanted(streams, wanted, {}))
    assert options_of(found) == ["--image", "/theta/image_raw", "--remap", "sphere_info:=/theta/sphere_info"]


SECOND = 10**9
NAMES = ("front", "left", "right")
RIG = [Stream(f"/{name}/image_raw", IMAGE, 9, 30.0, name, 160, 120, "mono8") for name in NAMES]
INFOS = [Stream(f"/{name}/camera_info", CAMERA_INFO, 9, 30.0, name, 160, 120, "plumb_bob") for name in NAMES]
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


def recording(*streams, tree=None, **values):
    return OpenedBag(SimpleNamespace(path=Path("drive")), streams, tree or TransformTree(), {}, **values)


MOUNTED = frames(*(("base_link", name) for name in NAMES))


def test_a_rig_is_mapped_by_the_names_of_its_cameras():
    found = offer_map(recording(*RIG))
    assert found.command[-5:] == ["--rig", "rig.yaml", *(f"--camera={name}=/{name}/image_raw" for name in NAMES)]
    assert "that has these names" in found.note


def test_a_rig_file_says_which_cameras_there_are(monkeypatch):
    monkeypatch.setattr(offers, "read_rig", lambda path: SimpleNamespace(names=("a", "b")))
    monkeypatch.setattr(topics, "find_rig_topics", lambda *_: {"cameras/a/image_raw": "/left/image_raw"})
    found = offer_map(recording(*RIG, rig=Path("six.yaml")))
    assert found.command[-3:] == ["--rig", "six.yaml", "--camera=a=/left/image_raw"]
    assert found.note.endswith("without b")

    def refuse(*_):
        raise BagError("drive: topics: expected images of a, b, found none")

    monkeypatch.setattr(topics, "find_rig_topics", refuse)
    assert offer_map(recording(*RIG, rig=Path("six.yaml"))).missing == "expected images of a, b, found none"


def test_several_cameras_localize_by_the_map_of_their_rig_or_by_their_own_calibrations():
    unmounted, mounted = (offer_localize(recording(*RIG, tree=tree)).command for tree in (frames(), frames(RIG_LINK)))
    assert "rig.calibration=map" in mounted
    assert "--mounting" not in mounted
    assert unmounted == [*mounted, "--mounting", "0,0,0,0,0,0"]
    told = offer_localize(recording(*RIG, *INFOS, tree=MOUNTED))
    assert told.note == "ready, by 3 cameras"
    assert "rig.calibration=map" not in told.command
    assert "choose it by --image" in offer_localize(recording(*RIG, *INFOS)).missing
    assert "choose it by --image" in offer_localize(recording(RIG[0], RIG[1])).missing


def test_bare_geometry_needs_odometry_and_the_height_of_the_camera():
    one = (RIG[0], INFOS[0])
    assert offer_mcl(recording(*one, ODOM, tree=MOUNTED)).command[:3] == ["sphere_nav", "mcl", "CLOUD"]
    assert offer_mcl(recording(*one, tree=MOUNTED)).missing.startswith("expected odometry (nav_msgs/Odometry, or")
    assert "base_link and front on /tf_static, or the height" in offer_mcl(recording(*one, ODOM)).missing
    assert offer_mcl(recording(*one, ODOM, mounting="0,0,1,0,0,0")).command
    moving = frames(("odom", "base_link"), is_static=False)
    moving.add(se3_to_transform(SE3.identity(), SECOND, "base_link", "front"), is_static=True)
    assert offer_mcl(recording(*one, tree=moving)).command
    assert recording(*one, tree=moving).odometry == "/tf (odom to base_link)"


def test_a_panorama_is_offered_with_what_it_needs():
    for info, words in [
        ([Stream("/theta/sphere_info", SPHERE_INFO, 9, 30.0, "front")], ["--remap", "sphere_info:=/theta/sphere_info"]),
        ([], ["--set", "is_panorama=true"]),
    ]:
        image = Stream("/theta/image_raw", IMAGE, 9, 30.0, "front", 256, 128, "rgb8")
        for offer in (offer_localize, offer_mcl):
            found = offer(recording(image, *info, ODOM, tree=MOUNTED))
            assert found.command[-2:] == words
            assert ("whole spheres" in found.note) == (not info)
        assert offer_localize(recording(RIG[0])).missing  # no panorama: not twice as wide as high


def test_images_of_different_instants_are_no_pair(monkeypatch):
    monkeypatch.setattr(topics, "pairing_slack", lambda *_: 0.011)
    monkeypatch.setattr(topics, "nearest_pair_s", lambda *_: 0.25)
    with pytest.raises(BagError, match=r"/b: expected stamps within 11 ms of /a .*, found 250 ms at the nearest"):
        recording().check_stamps("/a", "/b")
