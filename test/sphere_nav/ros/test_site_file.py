"""A parameter file of a site, and rules of a command line: heard, or refused in one line that names what is not."""

from __future__ import annotations

from pathlib import Path

import pytest

from path_follower.ros.control import ControlLoop
from sphere_nav.ros.compositions import COMPOSITIONS, RESTART_AFTER
from sphere_nav.ros.shared_files import share_file
from sphere_nav.ros.site_file import check_rules, check_site_file
from sphere_nav_tools.cli.processes import start_command

NODES = tuple(RESTART_AFTER)


def check(tmp_path: Path, text: str) -> str:
    """Return why a file of this text is refused, behind its name; empty where it is heard."""
    file = tmp_path / "site.yaml"
    file.write_text(text)
    try:
        check_site_file(str(file), NODES)
    except ValueError as error:
        where, _, reason = str(error).partition(f"{file}: ")
        assert not where
        return reason
    return ""


def test_what_nodes_declare_is_heard(tmp_path: Path) -> None:
    for text in [
        "/**: {ros__parameters: {vehicle: {wheelbase: 1.2}, map: campus}}",  # of several nodes
        "/**: {ros__parameters: {vehicle.wheelbase: 1.2, use_sim_time: true}}",
        "/**/path_follower: {ros__parameters: {speed: {cruise: 1.0}, qos_overrides: {/pose: {subscription: {}}}}}",
        "/**: {ros__parameters: {}}\n/**/mcl_depth: {ros__parameters: {preset: indoor}}",
    ]:
        assert check(tmp_path, text) == ""


def test_the_shipped_file_of_a_vehicle_is_heard(tmp_path: Path) -> None:
    text = share_file("config/cycab.yaml").read_text()
    assert check(tmp_path, text) == ""
    assert check(tmp_path, text.replace("speed_lag", "sped_lag")).startswith("/**: actuation.sped_lag (is")


def test_what_no_node_hears_is_refused(tmp_path: Path) -> None:
    for text, message in [
        ("/**: {ros__parameters: {spped: {cruise: 1.0}}}", "/**: spped.cruise (is speed.cruise meant?): expected a"),
        ("/**/command_guard: {ros__parameters: {speed: {cruise: 1.0}}}", "speed.cruise: expected a parameter of these"),
        ("/**/path_folower: {ros__parameters: {map: x}}", "/**/path_folower (is /**/path_follower meant?): expected"),
        ("path_follower: {ros__parameters: {map: x}}", "(is /**/path_follower meant?): expected /**, or /**/ and one"),
        ("/**: {map: x}", "/**.ros__parameters: expected a value, found none"),
        ("/**: 3", "/**: expected the fields ros__parameters, found 3"),
        ("/**: {ros__parameters: {map: a, map: b}}", "twice"),
    ]:
        reason = check(tmp_path, text)
        assert message in reason
        assert "\n" not in reason


MANY = {"map": "m", "cloud": "c", "bag": "b", "routes": "r", "guard": "true", "record": "o", "trajectory": "t"}


def check_words(node, *rules, name="", namespace="/", heard=None, flag="-r"):
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
            check_words(node, rule, flag=flag)


def test_names_of_the_node_pass_in_every_form():
    own = ("image_raw:=/a", "/image_raw:=a", "/car2/odom:=b", "~/reset:=c", "cameras/x/image_raw:=e")
    named = ("finder/load_map:=d", "finder:pose:=f")
    assert check_words("dense_localizer", *own, *named, name="finder", namespace="/car2") == []
    assert check_words("path_follower", *(f"{topic}:=x" for topic in ControlLoop.TOPICS)) == []  # of its loop's process
    assert check_words("bag_recorder", "anything:=x") == check_words("bag_player", "anything:=x") == []
    assert check_words("dense_localizer", "__ns:=/a", "__node:=b", "base:anything:=x", "/clock:=clock") == []
    assert check_words("dense_localizer", "zed/left/compressed:=x", heard={"image_raw": "zed/left"}) == []
    assert check_words("of_a_user", "anything:=x") == []


def test_a_name_of_other_nodes_is_told():
    line = "-r cmd_vel: expected a topic or service of mcl_depth, found one of other nodes: it renames nothing here"
    assert check_words("mcl_depth", "cmd_vel:=/base/cmd_vel") == [line]


@pytest.mark.parametrize("name", COMPOSITIONS)
def test_what_compositions_rename_is_known_to_whom_it_is_given(name, tmp_path):
    known = COMPOSITIONS[name].arguments
    topics = {key: f"/x/{key}" for key in ("image", "info", "odom", "scan", "cmd_vel", "other", "path")}
    given = {key: value for key, value in (MANY | topics | {"namespace": "car2"}).items() if key in known}
    for start in COMPOSITIONS[name].starts(given):
        words = start_command(start, tmp_path)
        assert check_rules(words, start.node, start.node, f"/{start.namespace}", {}) == []
