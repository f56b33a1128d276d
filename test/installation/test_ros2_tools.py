"""With the real `ros2` of a ROS 2 installation: all launch files, what they refuse, and the tools beside a node.

`ros2` is taken from the variable ROS2 (a path), or else from PATH. It must find the very sphere_nav that is tested;
otherwise everything here is skipped. In an environment of wheels, which has no `ros2`, put the packages of ros2cli,
ros2launch, launch and launch_ros from their sources beside it.
"""

import os
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
import yaml
from geometry_msgs.msg import Twist
from sensor_msgs.msg import CameraInfo, Image
from sphere_nav_msgs.msg import LocalizationStatus
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from sphere_nav.geometry import SE3, Rig, Spherical
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav.ros import qos
from sphere_nav.ros.conversions import array_to_image, camera_to_info, se3_to_transform
from sphere_nav.ros.maps.reader import save_map
from sphere_nav.ros.shared_files import share_file
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from worlds.base import children, is_running
from worlds.localizer import PINHOLE, SMALL_IMAGES, at, make_map
from worlds.mcl import room_points
from worlds.patience import Patience, wait_until
from worlds.recordings import rgbd, stamp, write_bag
from worlds.rig import seen, vertical_rig
from worlds.room import wide_room

pytestmark = pytest.mark.dds

PATIENCE = 120.0  # s of a free machine, for eighteen processes at the same time
LONG = 600.0  # s after which a process hangs
PERIOD = 0.2  # s between two images
START_X = -0.5  # m
OPTICAL = "camera_optical"
GIVEN = {
    "mapping": ["rig:=rig.yaml", "bag:=six_cameras"],
    "localisation": ["map:=map"],
    "navigation": ["map:=map", "trajectory:=path.csv", "site:=site.yaml", "guard:=true"],
    "nav2": ["map:=map", "trajectory:=path.csv", "site:=site.yaml"],
    "mcl": ["cloud:=room.npy"],
    "simulation": ["map:=map", "trajectory:=path.csv", "record:=simulated"],
    "replay": ["map:=map", "bag:=drive"],
}
NODES = {
    "mapping": {"sphere_stitcher", "sphere_mapper", "bag_player"},
    "localisation": {"dense_localizer"},
    "navigation": {"dense_localizer", "path_follower", "command_guard"},
    "nav2": {"dense_localizer", "path_follower"},
    "mcl": {"mcl_depth"},
    "simulation": {"bag_recorder", "cycab_sim", "dense_localizer", "path_follower"},
    "replay": {"dense_localizer", "bag_player"},
}
SITE = {  # small images; on a busy machine messages come late, which is not what is tested here
    "dense_localizer": SMALL_IMAGES | {"input.timeout_s": 10.0},
    "path_follower": {"safety": {"max_pose_silence": 10.0, "max_status_silence": 10.0, "max_blind_time": 10.0}},
    "command_guard": {"deadline": 5.0},
}
COMMANDS = {"navigation": "cmd_vel", "nav2": "cmd_vel_smoothed"}  # of those that drive here


@pytest.fixture(scope="module")
def ros2() -> str:
    command = os.environ.get("ROS2") or shutil.which("ros2")
    if not command:
        pytest.skip("no ros2: neither the variable ROS2 nor PATH names one")
    done = subprocess.run([command, "pkg", "prefix", "sphere_nav"], capture_output=True, text=True, timeout=LONG)
    prefix = share_file("config/path_follower.yaml").parents[3]
    if Path(done.stdout.strip()).resolve() != prefix.resolve():
        pytest.skip(f"{command} finds sphere_nav in {done.stdout.strip() or 'no place'}, not in {prefix}")
    return command


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("files")
    made = make_map(wide_room(), [SE3.from_planar(x, 0.0, 0.0) for x in (-1.0, 0.0, 1.0)], Spherical(512, 256))
    save_map(folder / "map", made.graph)
    write_bag(folder / "drive", rgbd, numbers=range(2))
    rig = vertical_rig()
    write_rig(folder / "rig.yaml", rig)
    write_bag(folder / "six_cameras", lambda number: images(rig, number), numbers=range(1))
    np.save(folder / "room.npy", room_points(0.2))
    (folder / "path.csv").write_text("\n".join(f"{x},0" for x in np.arange(-1.0, 3.0, 0.5)))
    site = {f"/**/{node}": {"ros__parameters": values} for node, values in SITE.items()}
    (folder / "site.yaml").write_text(yaml.safe_dump(site))
    return folder


def images(rig: Rig, number: int) -> Iterator[tuple[str, Image]]:
    """Yield topic and message of one instant of a rig."""
    for part in rig.cameras:
        yield f"cameras/{part.name}/image_raw", array_to_image(seen(part), stamp(number), part.name, "mono8")


class Launched:
    """`ros2 launch` of one file in a namespace of its own, and what it prints."""

    def __init__(self, ros2: str, name: str, logs: Path, given: list[str], *, cwd: Path) -> None:
        words = [ros2, "launch", "sphere_nav", f"{name}.launch.py", *given]
        self.log = logs / f"{name}.log"
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(words, cwd=cwd, stdout=log, stderr=log, start_new_session=True)

    def interrupt(self) -> None:
        """Ctrl-C, as a terminal sends it: to all of the process group."""
        os.killpg(self.process.pid, signal.SIGINT)

    def __enter__(self) -> "Launched":
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait(120.0)


class Vehicle:
    """A camera that moves as it is told through the room."""

    def __init__(self, node: Any, name: str) -> None:
        self.node, self.x, self.speed, self.num_heard, self.asked = node, START_X, 0.0, 0, 0.0
        self.state, self.images = "", node.create_publisher(Image, f"{name}/image_raw", qos.STATE)
        self.infos = node.create_publisher(CameraInfo, f"{name}/camera_info", qos.STATE)
        mount = se3_to_transform(T_BODY_OPTICAL, 0, "base_link", OPTICAL)
        self.static = node.create_publisher(TFMessage, f"{name}/tf_static", qos.TF_STATIC)
        self.static.publish(TFMessage(transforms=[mount]))
        node.create_subscription(Twist, f"{name}/{COMMANDS[name]}", self.obey, qos.COMMAND)
        node.create_subscription(LocalizationStatus, f"{name}/status", self.hear, qos.STATE)
        self.start = node.create_client(Trigger, f"{name}/path_follower/start")
        self.has_driven = False

    def obey(self, message: Twist) -> None:
        self.speed = message.linear.x
        self.has_driven |= self.speed > 0.0

    def hear(self, message: LocalizationStatus) -> None:
        self.state = message.state

    def look(self, room: Any) -> None:
        """Take an image; ask for the drive as long as there is none."""
        self.x += self.speed * PERIOD
        stamp = self.node.get_clock().now().nanoseconds
        self.infos.publish(camera_to_info(PINHOLE, stamp, OPTICAL))
        picture = room.photograph(PINHOLE, at(self.x), seed=stamp % 1000)
        self.images.publish(array_to_image(picture, stamp, OPTICAL, "mono8"))
        if self.state == "TRACKING" and not self.has_driven and time.monotonic() - self.asked > 1.0:
            self.asked = time.monotonic()
            self.start.call_async(Trigger.Request())


def test_all_launch_files_start_their_nodes_and_end_in_order(ros2: str, files: Path) -> None:
    """Two of them drive; the last command that a base gets after Ctrl-C is zero."""
    given = {name: [*GIVEN[name], f"namespace:={name}"] for name in NODES}
    room, running = wide_room(), {name: Launched(ros2, name, files, given[name], cwd=files) for name in NODES}
    rclpy.init()
    try:
        node = rclpy.create_node("observer")
        vehicles = {name: Vehicle(node, name) for name in COMMANDS}
        left, seen, patience = set(NODES), set(), Patience(PATIENCE)
        while left and patience.is_left():
            for vehicle in vehicles.values():
                vehicle.look(room)
            until = time.monotonic() + PERIOD
            while (wait := until - time.monotonic()) > 0:
                rclpy.spin_once(node, timeout_sec=wait)
            seen |= {f"{space}/{name}" for name, space in node.get_node_names_and_namespaces()}
            for name in sorted(left):
                has_all = seen >= {f"/{name}/{wanted}" for wanted in NODES[name]}
                if has_all and (name not in vehicles or vehicles[name].has_driven):
                    left.remove(name)
                    running[name].interrupt()
        assert not left, "".join(running[name].log.read_text() for name in left)
        patience = Patience(PATIENCE)
        while any(item.process.poll() is None for item in running.values()) and patience.is_left():
            rclpy.spin_once(node, timeout_sec=0.05)
        for item in running.values():
            assert item.process.poll() == 0, item.log.read_text()
        patience = Patience(PATIENCE)
        while any(vehicle.speed for vehicle in vehicles.values()) and patience.is_left():
            rclpy.spin_once(node, timeout_sec=0.05)  # the last command may still be on its way
        assert {name: vehicle.speed for name, vehicle in vehicles.items()} == dict.fromkeys(COMMANDS, 0.0)
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
        for item in running.values():
            item.__exit__()


def test_nodes_end_with_a_launch_that_is_killed(ros2: str, files: Path, tmp_path: Path) -> None:
    """A follower must not drive on without it."""
    with Launched(ros2, "nav2", tmp_path, ["map:=map", "namespace:=killed"], cwd=files) as launched:
        assert wait_until(lambda: "killed.path_follower_loop]: NO_PATH" in launched.log.read_text(), PATIENCE)
        started = re.findall(r"process started with pid \[(\d+)\]", launched.log.read_text())
        found = [int(pid) for pid in started] + [child for pid in started for child in children(int(pid))]
        assert len(found) == len(NODES["nav2"]) + 1  # the loop of the follower has a front
        launched.process.kill()
        assert wait_until(lambda: not any(is_running(pid) for pid in found), PATIENCE)


def test_a_follower_answers_the_tools_of_ros2(ros2: str, files: Path, tmp_path: Path) -> None:
    """Why it does not start, a parameter that is fixed, a latched path for who comes late, and its lifecycle."""
    name = "/tools/path_follower"
    follower = [ros2, "run", "sphere_nav", "path_follower", "--ros-args", "-r", "__ns:=/tools"]
    seen = ["--no-daemon", "--spin-time", "4"]  # s for the discovery of the node, which on a busy machine takes longer
    asked = {
        "False, message='POSE_TIMEOUT: no pose yet": ["service", "call", f"{name}/start", "std_srvs/srv/Trigger"],
        "vehicle.wheelbase: fixed while the node": ["param", "set", *seen, name, "vehicle.wheelbase", "1.5"],
        r"3\.5|3\.49999": ["topic", "echo", *seen, "--once", "--field", "length", f"{name}/trajectory"],  # come late
        r"active \[3\]": ["lifecycle", "get", *seen, name],
    }
    words = [*follower, "-p", "trajectory:=path.csv"]
    with (tmp_path / "log").open("wb") as log:
        process = subprocess.Popen(words, cwd=files, stdout=log, stderr=log, start_new_session=True)

    def answer(words: list[str], wanted: str) -> str:
        """Ask until the answer is the wanted one: a tool that has not found the node yet says so, and ends."""
        patience, said = Patience(PATIENCE), ""
        while not re.search(wanted, said) and patience.is_left():
            said = subprocess.run([ros2, *words], capture_output=True, text=True, timeout=LONG).stdout
        return "" if re.search(wanted, said) else said

    try:
        assert wait_until(lambda: "IDLE" in (tmp_path / "log").read_text(), PATIENCE)
        with ThreadPoolExecutor() as pool:
            assert list(filter(None, pool.map(answer, asked.values(), asked))) == []
        assert answer(["lifecycle", "set", *seen, name, "deactivate"], "Transitioning successful") == ""
        os.killpg(process.pid, signal.SIGINT)
        assert process.wait(LONG) == 0
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait(120.0)
