"""`sphere_nav up`: two vehicles in one domain over real DDS, seen by who comes late; misuse; an orderly end."""

import signal
import subprocess
import sys

import pytest
import rclpy
from sphere_nav_msgs.msg import ReferenceTrajectory

from sphere_nav.geometry import SE3, Spherical
from sphere_nav.ros import qos
from sphere_nav.ros.compositions import NodeStart
from sphere_nav.ros.maps.reader import save_map
from sphere_nav.spheres.graph import SphereGraph
from sphere_nav_tools.cli.processes import Processes, start_command
from sphere_nav_tools.cli.up import watch
from worlds.localizer import make_map
from worlds.patience import Patience
from worlds.room import wide_room

PATIENCE = 60.0  # s of a loaded machine
NODES = ("dense_localizer", "path_follower")


def test_a_node_gets_its_words(tmp_path):
    start = NodeStart("mcl_depth", {"cloud": "a.ply"}, {"odom": "wheels"}, "car2", "site.yaml", "/car2/mcl_depth")
    words = start_command(start, tmp_path)[4:]
    assert words[:3] == ["--ros-args", "-r", "__ns:=/car2"]
    assert words[3:5] == ["--enclave", "/car2/mcl_depth"]
    assert words[5:7] == ["-r", "odom:=wheels"]
    assert words[7:] == ["--params-file", "site.yaml", "--params-file", str(tmp_path / "mcl_depth.yaml")]
    assert "cloud: a.ply" in (tmp_path / "mcl_depth.yaml").read_text()


def up(*words):
    code = "import sys; from sphere_nav_tools.cli.main import main; sys.exit(main())"
    return subprocess.Popen([sys.executable, "-c", code, "up", *words])


def test_a_node_that_dies_starts_again(tmp_path, capfd):
    """The first time it fails, the second time it ends as if it were told to; the other one ends with it."""
    mark = f"import pathlib, sys; mark = pathlib.Path({str(tmp_path / 'mark')!r}); found = mark.exists(); mark.touch()"
    guard = [sys.executable, "-S", "-c", f"{mark}; sys.exit(0 if found else 3)"]
    other = [sys.executable, "-S", "-c", "import time; time.sleep(60)"]
    with Processes() as nodes:
        assert watch(nodes, {"command_guard": guard, "path_follower": other}) == 1
        assert nodes.end() == {"path_follower": -signal.SIGINT}
    told = capfd.readouterr().err
    assert "up: command_guard ended with status 3; it starts again" in told
    assert "up: command_guard ended with status 0; the others end, too" in told


@pytest.fixture
def vehicles(tmp_path):
    """Two navigations by the same map, each in its namespace."""
    made = make_map(wide_room(), [SE3.identity(), SE3.from_planar(1.0, 0.0, 0.0)], Spherical(128, 64))
    save_map(tmp_path / "map", SphereGraph(made.graph))
    (tmp_path / "path.csv").write_text("0,0\n1,0\n2,0\n")
    (tmp_path / "site.yaml").write_text("/**/path_follower:\n  ros__parameters:\n    speed:\n      cruise: 0.7\n")
    words = [f"map:={tmp_path / 'map'}", f"trajectory:={tmp_path / 'path.csv'}", f"site:={tmp_path / 'site.yaml'}"]
    found = [up("navigation", *words, "stamped_cmd_vel:=true", f"namespace:={name}") for name in ("a", "b")]
    rclpy.init()
    try:
        yield found
    finally:
        rclpy.try_shutdown()
        for process in found:
            process.kill()
            process.wait(120.0)


@pytest.mark.dds
def test_two_vehicles_share_a_domain(vehicles):
    node, got = rclpy.create_node("late"), {}

    def names():
        return {f"{space}/{name}" for name, space in node.get_node_names_and_namespaces()}

    def wait(is_done):
        patience = Patience(PATIENCE)
        while not is_done() and patience.is_left():
            rclpy.spin_once(node, timeout_sec=0.1)
        return is_done()

    wanted = {f"/{car}/{name}" for car in "ab" for name in NODES}
    assert wait(lambda: wanted <= names()), names()
    for car in "ab":
        topic = f"/{car}/path_follower/trajectory"
        assert wait(lambda topic=topic: node.count_publishers(topic))
        node.create_subscription(ReferenceTrajectory, topic, lambda m, car=car: got.update({car: m}), qos.LATCHED)
    assert wait(lambda: len(got) == 2)  # latched: whoever comes late gets it
    assert max(point.speed for point in got["a"].points) == pytest.approx(0.7)  # of the site
    topics = dict(node.get_topic_names_and_types())
    assert topics["/a/cmd_vel"] == topics["/b/cmd_vel"] == ["geometry_msgs/msg/TwistStamped"]
    assert {"/cmd_vel", "/pose", "/tf", "/tf_static"}.isdisjoint(topics)
    for process in vehicles:
        process.send_signal(signal.SIGINT)
    assert [process.wait(PATIENCE) for process in vehicles] == [0, 0]
    assert wait(lambda: not wanted & names())
    node.destroy_node()
