"""A rig names its cameras, and refuses what is no rig."""

import pytest

from sphere_nav.geometry import SE3, Pinhole, Rig, RigCamera

CAMERA = Pinhole(64, 48, 40.0, 40.0, 31.5, 23.5)


def part(name, level=""):
    return RigCamera(name, CAMERA, SE3.identity(), level=level)


def test_cameras_are_found_by_name_and_level_and_an_unknown_one_is_named_with_those_there_are():
    rig = Rig((part("front_top", "top"), part("front_bottom", "bottom")), "vertical")
    assert rig.is_vertical
    assert rig.camera("front_bottom").level == "bottom"
    assert [camera.name for camera in rig.at_level("top")] == ["front_top"]
    assert not Rig((part("a"), part("b"))).is_vertical
    with pytest.raises(ValueError, match="rig rig: expected a camera c, found a, b"):
        Rig((part("a"), part("b"))).camera("c")


def test_what_is_no_rig_and_a_name_that_does_not_fit_into_a_topic_are_refused():
    for parts, match in [
        ([], "expected at least one"),
        ([("a", ""), ("a", "")], "expected different names, found a, a"),
        ([("a", "top"), ("b", "")], "level: expected top and bottom"),
    ]:
        with pytest.raises(ValueError, match=match):
            Rig(tuple(part(*words) for words in parts))
    for name in ["", "front left", "1", "a/b"]:
        with pytest.raises(ValueError, match="camera name"):
            part(name)
