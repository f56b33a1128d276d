"""Compositions name nodes, parameters and files that exist; every launch file is one, and every one has its file."""

from __future__ import annotations

import ast
import re
import sys
import types
from pathlib import Path
from typing import Any

import pytest

from config.test_yaml_matches_params import NODES, ROOT, generate
from sphere_nav.params import leaves
from sphere_nav.ros.compositions import COMPOSITIONS, NodeStart

LAUNCH_FILES = sorted((ROOT / "launch").glob("*.launch.py"))
BY_NAME = {node.NAME: node for node in NODES}
GIVEN = {"map": "campus", "cloud": "town.ply", "bag": "drive", "rig": "rig.yaml", "record": "out", "guard": "true"}
ABSOLUTE = {"/tf", "/tf_static", "/clock"}


def starts(name: str, **more: str) -> list[NodeStart]:
    """Return what a composition starts with as much as possible turned on."""
    composition = COMPOSITIONS[name]
    return composition.starts({key: value for key, value in GIVEN.items() if key in composition.arguments} | more)


def name_of(path: Path) -> str:
    return path.name.removesuffix(".launch.py")


def test_every_composition_has_its_launch_file() -> None:
    assert {name_of(path) for path in LAUNCH_FILES} == set(COMPOSITIONS)
    assert set(BY_NAME) - {start.node for name in COMPOSITIONS for start in starts(name)} == set()


@pytest.mark.parametrize("name", COMPOSITIONS)
def test_nodes_and_their_parameters_exist(name: str) -> None:
    for start in starts(name):
        known = {leaf.name: leaf for cls in (BY_NAME[start.node].PARAMS, generate.ShellParams) for leaf in leaves(cls)}
        for key, value in start.parameters.items():
            if key != "use_sim_time":
                assert type(value) is known[key].type, f"{name}: {start.node}.{key}"
                known[key].check(value)


@pytest.mark.parametrize("name", COMPOSITIONS)
def test_topics_that_are_renamed_exist(name: str) -> None:
    """The name stands in some file of the packages, as a text of its own."""
    packages = ("sphere_nav/ros", "path_follower", "mcl_depth", "sphere_mapping")
    files = [path for package in packages for path in (ROOT / package).rglob("*.py")]
    words = {node.value for path in files for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
             if isinstance(node, ast.Constant) and isinstance(node.value, str)}  # fmt: skip
    changed = {key: f"x{key}" for key in COMPOSITIONS[name].arguments if key in ("image", "info", "odom", "cmd_vel")}
    for start in starts(name, **changed):
        assert set(start.topics) - ABSOLUTE - words == set()


@pytest.mark.parametrize("name", COMPOSITIONS)
def test_a_namespace_and_a_site_reach_every_node(name: str) -> None:
    for start in starts(name, namespace="/car2", site="site.yaml"):
        assert start.namespace == "car2"
        assert start.site == "site.yaml"
        assert {topic: topic[1:] for topic in ABSOLUTE}.items() <= start.topics.items()
    assert all(ABSOLUTE.isdisjoint(start.topics) for start in starts(name))


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        ("localisation", {}, "map: expected a value"),
        ("localisation", {"map": "m", "drive": "true"}, "drive: expected one of map, image"),
        ("mapping", {"input": "lidar"}, "input: expected sphere, rgbd, stereo, found 'lidar'"),
        ("mapping", {"bag": "b", "rate": "fast"}, "rate: expected a number, found 'fast'"),
        ("navigation", {"map": "m", "guard": "perhaps"}, "guard: expected true or false"),
    ],
)
def test_wrong_arguments_are_refused_in_one_line(name: str, given: dict[str, str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        COMPOSITIONS[name].starts(given)


def test_commands_reach_the_base_through_the_guard_alone() -> None:
    topics = {start.node: dict(start.topics) for start in starts("navigation", cmd_vel="base/cmd_vel")}
    assert topics["path_follower"]["cmd_vel"] == "cmd_vel_in"
    assert topics["command_guard"]["cmd_vel"] == "base/cmd_vel"
    assert starts("nav2", guard="false")[1].topics["cmd_vel"] == "cmd_vel_smoothed"


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_a_launch_file_starts_what_up_starts(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a stand-in for `launch`, which is not in the wheels: what is declared, and the nodes with their values."""
    stand_in: dict[str, Any] = {}

    def record(kind: str) -> Any:
        return lambda *words, **values: types.SimpleNamespace(kind=kind, words=words, **values)

    class Configuration:
        def __init__(self, key: str) -> None:
            self.key = key

        def perform(self, context: dict[str, str]) -> str:
            return context[self.key]

    for module, names in {
        "launch": {"LaunchDescription": lambda items: items},
        "launch.actions": {kind: record(kind) for kind in ("DeclareLaunchArgument", "OpaqueFunction")},
        "launch.substitutions": {"LaunchConfiguration": Configuration},
        "launch_ros": {},
        "launch_ros.actions": {"Node": record("Node")},
    }.items():
        stand_in[module] = types.ModuleType(module)
        stand_in[module].__dict__.update(names)
        monkeypatch.setitem(sys.modules, module, stand_in[module])
    monkeypatch.delitem(sys.modules, "sphere_nav.ros.launching", raising=False)
    from sphere_nav.ros.launching import launch_description

    space: dict[str, Any] = {}
    exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), space)
    assert space["launch_description"] is launch_description  # that of the stand-ins
    *declared, opaque = space["generate_launch_description"]()
    monkeypatch.delitem(sys.modules, "sphere_nav.ros.launching", raising=False)
    values = {item.words[0]: item.default_value for item in declared}
    assert set(values) == set(COMPOSITIONS[name_of(path)].arguments)
    assert all(item.description for item in declared)
    values |= {key: GIVEN[key] for key in values if values[key] is None}
    expected = COMPOSITIONS[name_of(path)].starts(values)
    nodes = opaque.function(values)
    assert [(n.executable, n.namespace, n.remappings) for n in nodes] == [
        (start.node, start.namespace, list(start.topics.items())) for start in expected
    ]
    assert [n.parameters[-1] for n in nodes] == [dict(start.parameters) for start in expected]


def test_examples_of_launch_files_name_arguments() -> None:
    for path in LAUNCH_FILES:
        for command in re.findall(r"\.launch\.py (\S.*)", ast.get_docstring(ast.parse(path.read_text())) or ""):
            words = re.findall(r"(\w+):=", command)
            assert set(words) <= set(COMPOSITIONS[name_of(path)].arguments), f"{path.name}: {command}"


def test_the_player_waits_for_what_the_driver_calls_the_images() -> None:
    mapper, player = starts("mapping", driver="zed4", rig="", bag="drive")
    assert (mapper.parameters["input"], player.parameters["wait_for"]) == (
        "rgbd",
        "zed/zed_node/depth/depth_registered",
    )
    player = starts("replay", driver="zed4")[-1]
    assert player.parameters["wait_for"] == "zed/zed_node/rgb/image_rect_color"
    player = starts("replay", driver="zed4", image="/front/image")[-1]
    assert player.parameters["wait_for"] == "/front/image"


def test_several_cameras_are_given_to_the_localizer() -> None:
    given = {"map": "campus", "cameras": "front,back", "rig": "map"}
    (start,) = COMPOSITIONS["localisation"].starts(given)
    assert (start.parameters["rig.cameras"], start.parameters["rig.calibration"]) == ("front,back", "map")
    (alone,) = COMPOSITIONS["localisation"].starts({"map": "campus"})
    assert not {"rig.cameras", "rig.calibration"} & set(alone.parameters)  # a parameter file may name them
