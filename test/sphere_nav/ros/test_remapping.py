"""Rules of a command line: unknown names are refused, those that a launch file gives to all nodes are not."""

import pytest

from path_follower.ros.control import ControlLoop
from sphere_nav.ros.compositions import COMPOSITIONS
from sphere_nav.ros.site_file import check_rules
from sphere_nav_tools.cli.processes import ros_arguments

MANY = {"map": "m", "cloud": "c", "bag": "b", "routes": "r", "guard": "true", "record": "o", "trajectory": "t"}


def check(node, *rules, name="", namespace="/", heard=None, flag="-r"):
    words = [word for rule in rules for word in (flag, rule)]
    return check_rules(["--ros-args", *words], node, name or node, namespace, heard or {})


@pytest.mark.parametrize(
    ("node", "rule", "hint"),
    [
        ("dense_localizer", "imge_raw:=/front/image_raw", r"imge_raw \(is image_raw meant\?\)"),
        ("path_follower", "~/strat:=go", r"path_follower/strat \(is path_follower/start meant\?\)"),
        ("path_follower", "path_follower:scann:=/x", r"scann \(is scan meant\?\)"),
    ],
)
def test_a_name_that_no_node_has_is_refused_with_the_nearest(node, rule, hint):
    for flag in ("-r", "--remap"):
        expected = f"^-r {hint}: expected a topic or service of {node}, found one of no node$"
        with pytest.raises(ValueError, match=expected):
            check(node, rule, flag=flag)


def test_names_of_the_node_pass_in_every_form():
    own = ("image_raw:=/a", "/image_raw:=a", "/car2/odom:=b", "~/reset:=c", "cameras/x/image_raw:=e")
    named = ("finder/load_map:=d", "finder:pose:=f")
    assert check("dense_localizer", *own, *named, name="finder", namespace="/car2") == []
    assert check("path_follower", *(f"{topic}:=x" for topic in ControlLoop.TOPICS)) == []  # of its loop's process
    assert check("bag_recorder", "anything:=x") == check("bag_player", "anything:=x") == []
    assert check("dense_localizer", "__ns:=/a", "__node:=b", "base:anything:=x", "/clock:=clock") == []
    assert check("dense_localizer", "zed/left/compressed:=x", heard={"image_raw": "zed/left"}) == []
    assert check_rules(["-r", "words:=x", "--ros-args", "--", "-r", "more:=x"], "mcl_depth", "mcl_depth", "/", {}) == []
    assert check("of_a_user", "anything:=x") == []


def test_a_name_of_other_nodes_is_told():
    line = "-r cmd_vel: expected a topic or service of mcl_depth, found one of other nodes: it renames nothing here"
    assert check("mcl_depth", "cmd_vel:=/base/cmd_vel") == [line]


@pytest.mark.parametrize("name", COMPOSITIONS)
def test_what_compositions_rename_is_known_to_whom_it_is_given(name, tmp_path):
    known = COMPOSITIONS[name].arguments
    topics = {key: f"/x/{key}" for key in ("image", "info", "odom", "scan", "cmd_vel", "other", "path")}
    given = {key: value for key, value in (MANY | topics | {"namespace": "car2"}).items() if key in known}
    for start in COMPOSITIONS[name].starts(given):
        words = ros_arguments(start, tmp_path / "values.yaml")
        assert check_rules(words, start.node, start.node, f"/{start.namespace}", {}) == []
