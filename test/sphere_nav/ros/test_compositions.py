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
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav.params import leaves
from sphere_nav.ros.compositions import COMPOSITIONS, RESTART_AFTER, NodeStart, after_exit
from worlds.rig import vertical_rig

MAX_RESTARTS = 5  # written out: imported, a change would go unseen

LAUNCH_FILES = sorted((ROOT / "launch").glob("*.launch.py"))
BY_NAME = {node.NAME: node for node in NODES}
GIVEN = {"map": "campus", "cloud": "town.ply", "bag": "drive", "rig": "rig.yaml", "record": "out", "guard": "true"}
GIVEN["routes"] = "campus"
ABSOLUTE = {"/tf", "/tf_static", "/clock"}


@pytest.fixture(autouse=True)
def _files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_rig(tmp_path / "rig.yaml", vertical_rig())
    (tmp_path / "town.ply").touch()
    for name in ("campus", "drive"):
        (tmp_path / name).mkdir()


def starts(name: str, **more: str) -> list[NodeStart]:
    """Return what a composition starts with as much as possible turned on."""
    composition = COMPOSITIONS[name]
    return composition.starts({key: value for key, value in GIVEN.items() if key in composition.arguments} | more)


def name_of(path: Path) -> str:
    return path.name.removesuffix(".launch.py")


def test_every_composition_has_its_launch_file_whose_examples_name_arguments() -> None:
    assert {name_of(path) for path in LAUNCH_FILES} == set(COMPOSITIONS)
    assert set(BY_NAME) - {start.node for name in COMPOSITIONS for start in starts(name)} == set()
    for path in LAUNCH_FILES:
        for command in re.findall(r"\.launch\.py (\S.*)", ast.get_docstring(ast.parse(path.read_text())) or ""):
            words = re.findall(r"(\w+):=", command)
            assert set(words) <= set(COMPOSITIONS[name_of(path)].arguments), f"{path.name}: {command}"


def test_nodes_and_their_parameters_exist_and_a_namespace_and_a_site_reach_them() -> None:
    for name in COMPOSITIONS:
        for start in starts(name):
            classes = (BY_NAME[start.node].PARAMS, generate.ShellParams)
            known = {leaf.name: leaf for cls in classes for leaf in leaves(cls)}
            for key, value in start.parameters.items():
                if key != "use_sim_time":
                    assert type(value) is known[key].type, f"{name}: {start.node}.{key}"
                    known[key].check(value)
        for start in starts(name, namespace="/car2", site="site.yaml"):
            assert start.namespace == "car2"
            assert start.site == "site.yaml"
            assert {topic: topic[1:] for topic in ABSOLUTE}.items() <= start.topics.items()
        assert all(ABSOLUTE.isdisjoint(start.topics) for start in starts(name))


def test_wrong_arguments_are_refused_in_one_line() -> None:
    for name, given, message in [
        ("localisation", {}, "map: expected a value"),
        ("localisation", {"map": "m", "drive": "true"}, r"drive \(is driver meant\?\): expected one of map, image"),
        ("localisation", {"map": "gone"}, "map: expected a file or folder that exists, found 'gone'"),
        ("localisation", {"map": "m", "image": "front image"}, "image: expected letters, digits, _ and /"),
        (
            "localisation",
            {"map": "campus", "site": "rig.yaml"},
            r"rig.yaml: \w+.*: expected /\*\*, or /\*\*/ and",
        ),
    ]:
        with pytest.raises(ValueError, match=message):
            COMPOSITIONS[name].ready(given)


def test_what_follows_when_a_node_ends() -> None:
    """Who holds nothing starts again after a crash, a few times; nobody does whose end was meant."""
    assert {start.node for name in COMPOSITIONS for start in starts(name)} <= set(RESTART_AFTER)
    assert after_exit("dense_localizer", -9, 0) == 2.0
    assert 0.0 < after_exit("command_guard", 1, MAX_RESTARTS - 1) <= 0.1
    assert after_exit("bag_player", 0, 0) is None
    ends = [("command_guard", -9, MAX_RESTARTS), ("dense_localizer", 2, 0), ("bag_player", 1, 0)]
    for node, status, restarts in [*ends, ("path_follower", 0, 0), ("sphere_mapper", -9, 0), ("mcl_depth", 0, 0)]:
        with pytest.raises(RuntimeError, match=f"{node} ended with status {status}; the others end, too"):
            after_exit(node, status, restarts)


def keys(folder: Path, starts: list[NodeStart], monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Make the files of a keystore that are looked for, and set the variables that name it."""
    files = [folder / f"enclaves{start.enclave}/permissions.p7s" for start in starts]
    for file in files:
        file.parent.mkdir(parents=True)
        file.touch()
    for name, value in {"KEYSTORE": str(folder), "ENABLE": "true", "STRATEGY": "Enforce"}.items():
        monkeypatch.setenv(f"ROS_SECURITY_{name}", value)
    return files


def test_no_node_starts_without_its_keys_where_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    navigation, given = COMPOSITIONS["navigation"], {"map": "campus", "security": "true", "namespace": "car2"}
    starts = navigation.starts(given)
    assert [start.enclave for start in starts] == ["/car2/dense_localizer", "/car2/path_follower"]
    with pytest.raises(ValueError, match="security: expected ROS_SECURITY_ENABLE=true, found 'nothing'"):
        navigation.ready(given)
    files = keys(tmp_path, starts, monkeypatch)
    assert navigation.ready(given) == starts
    files[1].unlink()
    with pytest.raises(ValueError, match=r"expected .*/car2/path_follower/permissions.p7s .*keystore makes it"):
        navigation.ready(given)
    monkeypatch.setenv("ROS_SECURITY_STRATEGY", "Permissive")
    with pytest.raises(ValueError, match="expected ROS_SECURITY_STRATEGY=Enforce, found 'Permissive'"):
        navigation.ready(given)
    monkeypatch.setenv("ROS_SECURITY_STRATEGY", "Enforce")
    monkeypatch.setenv("ROS_SECURITY_ENCLAVE_OVERRIDE", "/operator")
    with pytest.raises(ValueError, match="expected no ROS_SECURITY_ENCLAVE_OVERRIDE, found '/operator'"):
        navigation.ready(given)
    assert {start.enclave for start in navigation.starts({"map": "campus"})} == {""}


def test_commands_reach_the_base_through_the_guard_alone() -> None:
    topics = {start.node: dict(start.topics) for start in starts("navigation", cmd_vel="base/cmd_vel")}
    assert topics["path_follower"]["cmd_vel"] == "cmd_vel_in"
    assert topics["command_guard"]["cmd_vel"] == "base/cmd_vel"
    assert starts("nav2", guard="false")[1].topics["cmd_vel"] == "cmd_vel_smoothed"


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_a_launch_file_starts_what_up_starts(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a stand-in for `launch`, which is not in the wheels: what is declared, and the nodes with their values."""
    stand_in: dict[str, Any] = {}

    def record(kind: str) -> Any:
        return lambda *words, **values: types.SimpleNamespace(kind=kind, words=words, **values)

    class Configuration:
        def __init__(self, key: str, default: str = "") -> None:
            self.key = key

        def perform(self, context: dict[str, str]) -> str:
            return context.launch_configurations[self.key]

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
    check, *declared, opaque = space["generate_launch_description"]()
    monkeypatch.delitem(sys.modules, "sphere_nav.ros.launching", raising=False)
    values = {item.words[0]: item.default_value for item in declared}
    assert set(values) == set(COMPOSITIONS[name_of(path)].arguments)
    assert all(item.description for item in declared)
    values |= {key: GIVEN[key] for key in values if values[key] is None} | {"security": "true"}
    keys(tmp_path, COMPOSITIONS[name_of(path)].starts(values), monkeypatch)
    expected = COMPOSITIONS[name_of(path)].starts(values)
    nodes = opaque.function(types.SimpleNamespace(launch_configurations=values))
    told = [(start.node, start.namespace, list(start.topics.items())) for start in expected]
    assert [(n.executable, n.namespace, n.remappings) for n in nodes] == told
    assert [n.ros_arguments for n in nodes] == [["--enclave", f"/{start.node}"] for start in expected]
    assert [n.parameters[-1] for n in nodes] == [dict(start.parameters) for start in expected]
    delays = [RESTART_AFTER[start.node] for start in expected]
    assert [n.respawn_delay for n in nodes if n.respawn] == list(filter(None, delays))
    typed = types.SimpleNamespace(argv=["nmae:=car2"], launch_configurations={"nmae": "car2"})
    with pytest.raises(ValueError, match=r"nmae.*: expected one of"):
        check.function(typed)
    included = types.SimpleNamespace(argv=[], launch_configurations={"namespce": "car2", "robot": "r2"})
    check.function(included)  # of a launch file that includes this one, which may have names of its own
    for node, start in zip(nodes, expected, strict=True):
        running, ending = (types.SimpleNamespace(is_shutdown=is_over) for is_over in (False, True))
        node.on_exit(types.SimpleNamespace(returncode=0), ending)
        node.on_exit(types.SimpleNamespace(returncode=-2), ending)
        for context in (running, ending):
            with pytest.raises(RuntimeError, match=f"{start.node} ended with status 2"):
                node.on_exit(types.SimpleNamespace(returncode=2), context)


def test_the_player_waits_for_what_the_driver_calls_the_images() -> None:
    mapper, player = starts("mapping", driver="zed4", rig="", bag="drive")
    assert mapper.parameters["input"] == "rgbd"
    assert player.parameters["wait_for"] == "zed/zed_node/depth/depth_registered"
    player = starts("replay", driver="zed4")[-1]
    assert player.parameters["wait_for"] == "zed/zed_node/rgb/image_rect_color"
    player = starts("replay", driver="zed4", image="/front/image")[-1]
    assert player.parameters["wait_for"] == "/front/image"
    assert starts("mapping")[-1].parameters["wait_for"] == "cameras/top_front/image_raw"
