"""Each node may open what it opens, and nothing else; the real `ros2 security` makes the keys, where there is one."""

import gc
import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import rclpy
from rclpy.parameter import Parameter

from cycab_sim.ros.node import CycabSim
from dense_localizer.ros.node import DenseLocalizerNode
from mcl_depth.ros.node import MclDepthNode
from path_follower.ros.guard_node import CommandGuard
from path_follower.ros.navigator_node import RouteNavigator
from path_follower.ros.node import PathFollowerNode
from path_follower.routes.building import build_network
from path_follower.routes.network_file import write_network
from sphere_mapping.acquisition.ros.node import SphereStitcher
from sphere_mapping.ros.node import SphereMapper
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav.ros.camera.drivers import read_driver
from sphere_nav.ros.compositions import COMPOSITIONS, NodeStart
from sphere_nav.ros.live import LiveShell
from sphere_nav.ros.shared_files import share_file
from sphere_nav_tools.cli.keystore import policy_of
from sphere_nav_tools.cli.main import main
from sphere_nav_tools.cli.processes import start_command
from worlds.curves import straight_road
from worlds.patience import Patience, wait_until
from worlds.rig import vertical_rig

PATIENCE = 60.0  # s
Names = set[tuple[str, str]]  # publish or subscribe, topic of DDS
COMPRESSED = {"transport": "compressed"}
WAYS = (  # parameters with which a node opens other topics
    (DenseLocalizerNode, {}),
    (DenseLocalizerNode, COMPRESSED),
    (DenseLocalizerNode, {"use_depth": True}),
    (DenseLocalizerNode, {"use_depth": True} | COMPRESSED),
    (DenseLocalizerNode, {"rig.cameras": "left,right"}),
    (DenseLocalizerNode, {"rig.cameras": "left,right"} | COMPRESSED),
    (MclDepthNode, {"survey.crs": "EPSG:32632"}),
    (MclDepthNode, COMPRESSED),
    (PathFollowerNode, {}),
    (PathFollowerNode, {"source": "odometry"}),
    (PathFollowerNode, {"source": "homing"}),
    (CommandGuard, {}),
    (RouteNavigator, {"network": "routes.geojson"}),
    (SphereStitcher, {}),
    (SphereStitcher, {"rig": "rig.yaml", "stitch.width": 128, "has_depth": True, "has_cloud": True}),
    (SphereStitcher, {"rig": "rig.yaml", "stitch.width": 128} | COMPRESSED),
    *((SphereMapper, {"input": kind} | more) for kind in ("sphere", "rgbd", "stereo") for more in ({}, COMPRESSED)),
    (CycabSim, {"world": "corridor", "imu.is_on": True, "scan.is_on": True, "rig.kind": "vertical"}),
    (CycabSim, {"world": "corridor", "camera.model": "panorama", "camera.size": "128,64"}),
)
ELSEWHERE = ("ackermann_cmd", "navigate_to_pose", "_loop/")  # packages that wheels lack; the loop's own process
ACTION = ("send_goal", "get_result", "cancel_goal")


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_network(tmp_path / "routes.geojson", build_network([straight_road(20.0)]))
    write_rig(tmp_path / "rig.yaml", vertical_rig())
    return tmp_path


@pytest.fixture(scope="module")
def ros2_security() -> Iterator[None]:
    """The real `ros2` with its package sros2 on the PATH."""
    ros2 = os.environ.get("ROS2") or shutil.which("ros2")
    if not ros2 or subprocess.run([ros2, "security", "-h"], capture_output=True, check=False).returncode:
        pytest.skip("no `ros2 security`: neither the variable ROS2 nor PATH names a ros2 with the package sros2")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", f"{Path(ros2).parent}:{os.environ['PATH']}")
        yield


def as_dds(kind: str, way: str, name: str) -> Names:
    """Return what DDS is asked for where a node publishes, subscribes, replies, requests, executes or calls."""
    if kind == "action":
        inner = "reply" if way == "execute" else "request"
        shown = "publish" if way == "execute" else "subscribe"
        services = [as_dds("service", inner, f"{name}/_action/{word}") for word in ACTION]
        return set().union(*services, *(as_dds("topic", shown, f"{name}/_action/{w}") for w in ("feedback", "status")))
    if kind == "topic":
        return {(way, f"rt{name}")}
    asks, answers = ("subscribe", "publish") if way == "reply" else ("publish", "subscribe")
    return {(asks, f"rq{name}Request"), (answers, f"rr{name}Reply")}


def granted(policy: Any, effect: str = "ALLOW") -> dict[str, Names]:
    """Return what each enclave of a policy may, or must not, as patterns of DDS."""
    found: dict[str, Names] = {}
    for enclave in policy.iter("enclave"):
        names = found.setdefault(enclave.get("path"), set())
        for profile in enclave.iter("profile"):
            space = profile.get("ns").rstrip("/")
            own = f"{space}/{profile.get('node')}/"
            for rules in profile:
                for way in (way for way, value in rules.items() if value == effect):
                    for rule in rules:
                        name = str(rule.text).replace("~/", own)
                        names |= as_dds(rule.tag, way, name if name.startswith("/") else f"{space}/{name}")
    return found


def opened(observer: Any, name: str) -> Iterator[tuple[str, str]]:
    """Yield what a node has open, as DDS is asked for it."""
    for kind, way, what in (
        ("topic", "publish", "publisher"),
        ("topic", "subscribe", "subscriber"),
        ("service", "reply", "service"),
        ("service", "request", "client"),
    ):
        for topic, _ in getattr(observer, f"get_{what}_names_and_types_by_node")(name, "/"):
            yield from as_dds(kind, way, topic)


def told(node: Any) -> Names:
    """Return what a node has open of its own as DDS tells it: not before that is all of what the node itself knows."""
    topics = [("publish", one.topic_name) for one in node.publishers]
    topics += [("subscribe", one.topic_name) for one in node.subscriptions]
    calls = [("reply", one.service_name) for one in node.services]
    calls += [("request", one.service_name) for one in node.clients]
    own = set[tuple[str, str]]().union(
        *(as_dds("topic", *one) for one in topics), *(as_dds("service", *one) for one in calls)
    )
    assert wait_until(lambda: own <= set(opened(node, node.get_name())), 60.0), node.get_node_names()
    return set(opened(node, node.get_name()))


def opens(node_class: Any, values: dict[str, Any]) -> Names:
    """Return what a node opens with some parameters."""
    overrides = [Parameter(name, value=value) for name, value in {**values, "use_sim_time": True}.items()]
    shell = LiveShell(node_class, parameter_overrides=overrides)
    try:
        assert shell.start(), (node_class.NAME, values)
        return told(shell)
    finally:
        shell.stop()
        shell.destroy_node()


def allowed(patterns: Names, wanted: tuple[str, str]) -> bool:
    return any(way == wanted[0] and fnmatchcase(wanted[1], name) for way, name in patterns)


def shipped() -> dict[str, Names]:
    return granted(ElementTree.parse(share_file("config/security.policy.xml")))


@pytest.mark.dds
def test_each_node_may_open_what_it_opens_and_nothing_else(files: Path) -> None:
    """With all parameters that change it; the loops of follower and guard are a part of their nodes here."""
    may, seen = shipped(), dict[str, Names]()
    for node_class, values in WAYS:
        rclpy.init()
        try:
            seen.setdefault(f"/{node_class.NAME}", set()).update(opens(node_class, values))
        finally:
            rclpy.try_shutdown()
        gc.collect()  # of two nodes of one name DDS tells of the first alone, which lives as long as its objects
    assert {node: [one for one in sorted(names) if not allowed(may[node], one)] for node, names in seen.items()} == {
        node: [] for node in seen
    }
    for node, names in seen.items():
        unused = {(way, rule) for way, rule in may[node] if not any(allowed({(way, rule)}, one) for one in names)}
        assert {one for one in unused if not any(word in one[1] for word in ELSEWHERE)} == set(), node


def test_whom_the_base_obeys_and_who_may_let_it_drive() -> None:
    may = shipped()

    def who(way: str, topic: str) -> set[str]:
        return {path.lstrip("/") for path, patterns in may.items() if allowed(patterns, (way, topic))} - {"bag_player"}

    assert who("publish", "rt/cmd_vel") == {"path_follower", "command_guard"}
    assert who("publish", "rt/pose") == {"dense_localizer", "mcl_depth"}
    assert who("publish", "rt/status") == {"dense_localizer", "mcl_depth"}
    assert who("publish", "rt/emergency_stop") == {"vehicle", "operator"}
    assert who("publish", "rt/initialpose") == {"operator"}
    for service in ("path_follower/start", "path_follower/drive", "path_follower/set_parameters"):
        may_ask = {"operator", "route_navigator"} if "drive" in service else {"operator"}
        assert who("publish", f"rq/{service}Request") == may_ask
        assert who("publish", f"rr/{service}Reply") - {"vehicle"} == {"path_follower"}
        denied = granted(ElementTree.parse(share_file("config/security.policy.xml")), "DENY")["/vehicle"]
        assert allowed(denied, ("publish", f"rr/{service}Reply"))


def test_permissions_follow_the_arguments() -> None:
    given = {"map": "campus", "guard": "true", "image": "/front/image_raw", "namespace": "car2", "scan": "laser/scan"}
    may = granted(policy_of(COMPOSITIONS["navigation"].starts(given)))
    nodes = ("dense_localizer", "path_follower", "command_guard", "vehicle", "operator", "bag_recorder")
    assert set(may) == {f"/car2/{name}" for name in nodes}
    assert may["/car2/path_follower"] & {("publish", f"rt/car2/{name}") for name in ("cmd_vel", "cmd_vel_in")} == {
        ("publish", "rt/car2/cmd_vel_in")
    }
    assert ("publish", "rt/car2/cmd_vel") in may["/car2/command_guard"]
    assert ("subscribe", "rt/car2/laser/scan") in may["/car2/path_follower"]
    assert ("subscribe", "rt/front/image_raw/compressed") in may["/car2/dense_localizer"]
    assert ("subscribe", "rt/car2/image_raw") not in may["/car2/dense_localizer"]
    assert ("publish", "rt/front/image_raw") in may["/car2/vehicle"]
    by_driver = granted(policy_of(COMPOSITIONS["mapping"].starts({"driver": "zed", "input": "rgbd"})))
    assert not allowed(by_driver["/sphere_mapper"], ("subscribe", "rt/image_raw"))
    compressed = f"rt/{read_driver('zed').names()['image_raw']}/compressed"
    assert ("subscribe", compressed) in by_driver["/sphere_mapper"]


@pytest.mark.dds
def test_a_keystore_grants_each_enclave_what_the_policy_says(ros2_security: None, tmp_path: Path, capsys: Any) -> None:
    """Each enclave has its keys, and a signed file of permissions that says what the policy says."""
    words = ["navigation", "map:=campus", "guard:=true", "routes:=campus", "namespace:=car2"]
    assert main(["keystore", str(tmp_path / "keys"), *words]) == 0, capsys.readouterr().err
    assert "keys for domain" in capsys.readouterr().out
    given = dict(word.split(":=") for word in words[1:])
    policy = policy_of(COMPOSITIONS["navigation"].starts(given))
    for effect, rule in (("ALLOW", "allow_rule"), ("DENY", "deny_rule")):
        for path, expected in granted(policy, effect).items():
            folder = tmp_path / "keys" / "enclaves" / path.lstrip("/")
            (grant,) = ElementTree.parse(folder / "permissions.xml").iter("grant")
            found = {
                (way.tag, str(topic.text))
                for rules in grant.iter(rule)
                for way in rules
                for topic in way.iter("topic")
                if topic.text != "ros_discovery_info"
            }
            assert found == expected, path
            assert (folder / "key.pem").stat().st_mode & 0o077 == 0
            assert {str(number.text) for number in grant.iter("id")} == {os.environ["ROS_DOMAIN_ID"]}
            signer = ["openssl", "smime", "-verify", "-CAfile", str(folder / "permissions_ca.cert.pem"), "-in"]
            done = subprocess.run([*signer, str(folder / "permissions.p7s")], capture_output=True, check=False)
            assert done.returncode == 0, done.stderr
    assert main(["keystore", str(tmp_path / "keys"), "mapping"]) == 0  # beside what is there


def secured(node: str, folder: Path) -> subprocess.Popen[str]:
    command = start_command(NodeStart(node, enclave=f"/{node}"), folder)
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True)


@pytest.mark.dds
def test_both_processes_of_a_follower_have_its_enclave(files: Path) -> None:
    may = shipped()["/path_follower"]
    process = secured("path_follower", files)
    rclpy.init()
    try:
        observer, patience = rclpy.create_node("observer"), Patience(PATIENCE)
        wanted = {("path_follower", "/", "/path_follower"), ("path_follower_loop", "/", "/path_follower")}
        names: Names = set()
        while ("publish", "rt/cmd_vel") not in names and patience.is_left():
            time.sleep(0.2)
            found = wanted & set(observer.get_node_names_and_namespaces_with_enclaves())
            for name, _, _ in found if found == wanted else ():
                names |= set(opened(observer, name))
        assert found == wanted
        assert [one for one in sorted(names) if not allowed(may, one)] == []
    finally:
        rclpy.try_shutdown()
        process.terminate()
        process.communicate(timeout=600.0)
