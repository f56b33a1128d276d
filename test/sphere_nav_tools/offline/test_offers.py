"""What is offered for a recording, and what is said to be missing; the commands are carried out in the zoo."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.samples import CAMERA_INFO, IMAGE, ODOMETRY, SPHERE, SPHERE_INFO
from sphere_nav.ros.bags.streams import Stream
from sphere_nav.ros.conversions import se3_to_transform
from sphere_nav.ros.tf import TransformTree
from sphere_nav_tools.offline import offers, topics
from sphere_nav_tools.offline.offers import OpenedBag, offer_localize, offer_map, offer_mcl

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


def test_the_cameras_of_a_rig_are_called_by_their_names():
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


def test_two_jobs_do_not_write_the_same_file():
    one = recording(RIG[0], INFOS[0], ODOM, tree=MOUNTED)
    outputs = [offer.command[offer.command.index("-o") + 1] for offer in (offer_localize(one), offer_mcl(one))]
    assert outputs == ["drive.tum", "drive_mcl.tum"]


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


def test_spheres_of_another_name_are_named():
    found = offer_map(recording(Stream("/car/sphere", SPHERE, 9, 2.0, "sphere_link")))
    assert found.command[-2:] == ["--remap", "sphere:=/car/sphere"]


def test_images_of_different_instants_are_no_pair(monkeypatch):
    monkeypatch.setattr(topics, "pairing_slack", lambda *_: 0.011)
    monkeypatch.setattr(topics, "nearest_pair_s", lambda *_: 0.25)
    with pytest.raises(BagError, match=r"/b: expected stamps within 11 ms of /a .*, found 250 ms at the nearest"):
        recording().check_stamps("/a", "/b")
