"""An hour of the real processes over DDS at 10 Hz: what do memory, descriptors, threads and shared memory do?

A base drives a circle behind follower and guard; a localiser sees images drawn along a street, back and forth; the
particle filter and the stitcher are fed once a second; a recorder writes what is small. The machine's other work goes
before all of it but the control loop, which asks for its own priority. Memory is what is anonymous (smaps_rollup):
pages of files come and go with other processes. Its growth is the median slope of all pairs of samples.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Bound, Headline, Report, Table

HELP = "an hour of the real processes at 10 Hz: memory, descriptors, threads, shared memory"
DOMAIN = "71"
PERIOD, SLOW = 0.1, 10  # s between two turns of the feeder; turns between two inputs of what is fed slowly
SAMPLING, WARM_UP = 10.0, 600.0  # s between two looks; in which caches fill, at most a third of the run
RADIUS, SWAY, SWAY_PERIOD = 20.0, 6.0, 20.0  # m of the circle; m and s of the camera's way back and forth
NOISE, NICE = 1.2, 5  # grey levels; of the processes
PATIENCE, RETRY = 120.0, 2.0  # s until it drives, where kernels may be compiled first; between two calls of start
EYES, PARTICLES, RIG = "/eyes", "/particles", "/rig"  # namespaces of what sees
TOPICS = (
    "pose status odom scan cmd_vel cmd_vel_in path_follower/status /tf /diagnostics "
    f"{EYES}/pose {EYES}/status {PARTICLES}/status"
)
MODULES = {
    "path_follower": "path_follower.ros.node",
    "command_guard": "path_follower.ros.guard_node",
    "dense_localizer": "dense_localizer.ros.node",
    "mcl_depth": "mcl_depth.ros.node",
    "sphere_stitcher": "sphere_mapping.acquisition.ros.node",
    "bag_recorder": "sphere_nav.ros.bags.recorder_node",
}


@dataclass(frozen=True)
class Look:
    """What a process held at one time: anonymous memory in kB, descriptors, threads, CPU in s."""

    anonymous: int
    handles: int
    threads: int
    cpu: float


def look(pid: int) -> Look:
    """Return what a process holds."""
    process = Path(f"/proc/{pid}")
    rollup = (process / "smaps_rollup").read_text(encoding="utf-8")
    stat = (process / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    seconds = (int(stat[11]) + int(stat[12])) / os.sysconf("SC_CLK_TCK")
    anonymous = int(rollup.partition("\nAnonymous:")[2].split()[0])
    return Look(anonymous, len(os.listdir(process / "fd")), int(stat[17]), seconds)


def children(pid: int) -> list[int]:
    """Return the processes beneath a process."""
    found = []
    for task in os.listdir(f"/proc/{pid}/task"):
        for child in Path(f"/proc/{pid}/task/{task}/children").read_text(encoding="ascii").split():
            found += [int(child), *children(int(child))]
    return found


def shared_bytes(pids: list[int]) -> int:
    """Return the bytes of /dev/shm that processes have mapped."""
    maps = [Path(f"/proc/{pid}/maps").read_text(encoding="utf-8").splitlines() for pid in pids]
    names = {line[line.index("/dev/shm/") :] for lines in maps for line in lines if "/dev/shm/" in line}
    return sum(os.stat(name).st_size for name in names if os.path.exists(name))


@contextmanager
def processes(arguments: Mapping[str, list[str]], ends: dict[str, int]) -> Iterator[dict[str, subprocess.Popen[bytes]]]:
    """Run nodes by name as processes of their own; `ends` gets their exit codes."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    running = {}
    for name, words in arguments.items():
        code = f"import sys; from {MODULES[name]} import main; sys.exit(main())"
        nice = [] if name == "path_follower" else ["nice", "-n", str(NICE)]
        command = [*nice, sys.executable, "-P", "-c", code, "--ros-args", *words, "--log-level", "warn"]
        running[name] = subprocess.Popen(command, env=environment)
    os.nice(NICE)
    try:
        yield running
    finally:
        for process in running.values():
            process.send_signal(signal.SIGINT)
        for name, process in running.items():
            try:
                ends[name] = process.wait(timeout=20.0)
            except subprocess.TimeoutExpired:
                process.kill()
                ends[name] = process.wait()


def arguments(folder: Path, street: Path) -> dict[str, list[str]]:
    """Return the command line of each node."""
    from benchmarks.abuse.nodes import rig_in

    turns = np.linspace(0.0, 2.0 * np.pi, 400)
    circle = [f"{RADIUS * np.sin(turn):.4f},{RADIUS * (1.0 - np.cos(turn)):.4f}" for turn in turns]
    (folder / "path.csv").write_text("\n".join(circle), encoding="utf-8")
    parameters: dict[str, dict[str, Any]] = {
        "path_follower": {"trajectory": folder / "path.csv", "path.is_closed": "true"},
        "command_guard": {},
        "dense_localizer": {"map": street},
        "mcl_depth": {"cloud": street, "input.timeout_s": 3.0},
        "sphere_stitcher": rig_in(folder),
        "bag_recorder": {"output": folder / "bag", "topics": f"'{TOPICS}'"},
    }
    remaps = {
        "path_follower": ["cmd_vel:=cmd_vel_in"],
        "dense_localizer": [f"__ns:={EYES}"],
        "mcl_depth": [f"__ns:={PARTICLES}", "/tf:=/particles/tf"],
        "sphere_stitcher": [f"__ns:={RIG}"],
    }
    found = {}
    for name, values in parameters.items():
        given = [word for key, value in values.items() for word in ("-p", f"{key}:={value}")]
        found[name] = given + [word for rule in remaps.get(name, []) for word in ("-r", rule)]
    return found


class Feeder:
    """The base, its sensors and the operator, who starts it again where it has stopped."""

    def __init__(self, views: list[NDArray[np.uint8]], camera: Any, T_base_camera: Any) -> None:
        import rclpy
        from geometry_msgs.msg import Twist
        from sphere_nav_msgs.msg import FollowerStatus, LocalizationStatus
        from std_srvs.srv import Trigger
        from tf2_msgs.msg import TFMessage

        from sphere_nav.geometry import SE3
        from sphere_nav.ros import conversions, qos

        self.node, self.qos, self.messages, self.SE3 = rclpy.create_node("base"), qos, conversions, SE3
        self.publishers: dict[str, Any] = {}
        self.views, self.camera = views, camera
        self.node.create_subscription(Twist, "cmd_vel", self._obey, qos.COMMAND)
        self.node.create_subscription(FollowerStatus, "path_follower/status", self._hear, qos.STATE)
        self.counts: Counter[str] = Counter()  # states of the images, reasons to stop
        for space in (EYES, PARTICLES):
            count = partial(self._count, space)
            self.node.create_subscription(LocalizationStatus, f"{space}/status", count, qos.STATE)
        self.start, self.request = self.node.create_client(Trigger, "path_follower/start"), Trigger.Request()
        self.pose = SE3.identity()
        self.speed = self.yaw_rate = self.way = self.asked = 0.0
        self.num_turns, self.moved, self.reason = 0, time.monotonic(), ""
        self.answer: Any = None
        mounts = {"camera_optical": T_base_camera, "laser": SE3.identity()}
        frames = [conversions.se3_to_transform(T, time.time_ns(), "base_link", name) for name, T in mounts.items()]
        self._say("/tf_static", TFMessage(transforms=frames), qos.TF_STATIC)

    def _obey(self, message: Any) -> None:
        self.speed, self.yaw_rate = message.linear.x, message.angular.z

    def _hear(self, message: Any) -> None:
        self.counts[message.reason] += bool(message.reason) and message.reason != self.reason
        self.reason = message.reason

    def _count(self, space: str, message: Any) -> None:
        self.counts[f"{space} {message.state}"] += 1

    def _say(self, topic: str, message: Any, profile: Any) -> None:
        if topic not in self.publishers:
            self.publishers[topic] = self.node.create_publisher(type(message), topic, profile)
        self.publishers[topic].publish(message)

    def live(self, seconds: float) -> None:
        """Let time pass."""
        import rclpy

        due = time.monotonic()
        end = due + seconds
        while time.monotonic() < end:
            if time.monotonic() >= due:
                due = max(due + PERIOD, time.monotonic() - PERIOD)
                self.turn()
            rclpy.spin_once(self.node, timeout_sec=max(min(due, end) - time.monotonic(), 0.001))

    def turn(self) -> None:
        """Move, and say once what the sensors see."""
        from sensor_msgs.msg import LaserScan
        from std_msgs.msg import Bool

        from benchmarks.abuse.nodes import pictures
        from sphere_nav.localization.status import State, Status

        elapsed, self.moved = time.monotonic() - self.moved, time.monotonic()
        step = self.SE3.from_planar(self.speed * elapsed, 0.0, self.yaw_rate * elapsed)
        self.pose, self.way = self.pose @ step, self.way + abs(self.speed) * elapsed
        stamp, state, covariance = time.time_ns(), self.qos.STATE, 1e-4 * np.eye(6)
        self._say("emergency_stop", Bool(data=False), state)
        self._say("status", self.messages.status_to_message(Status(State.TRACKING), stamp, "map"), state)
        self._say("pose", self.messages.se3_to_pose_with_covariance(self.pose, covariance, stamp, "map"), state)
        self._drive("odom", self.pose, np.array([self.speed, 0.0, 0.0, 0.0, 0.0, self.yaw_rate]), stamp)
        ranges = (15.0 + 0.01 * np.sin(np.arange(360) + self.num_turns)).tolist()
        scan = LaserScan(ranges=ranges, angle_min=-np.pi, angle_max=np.pi, angle_increment=2 * np.pi / 360)
        scan.range_min, scan.range_max, scan.header.frame_id = 0.1, 30.0, "laser"
        scan.header.stamp.sec, scan.header.stamp.nanosec = divmod(stamp, 10**9)
        self._say("scan", scan, self.qos.SENSOR)
        self._see(EYES, stamp)
        turned = 2.0 * np.pi * self.num_turns / len(self.views)
        swing = np.pi * SWAY / SWAY_PERIOD * np.sin(turned)
        self._drive(f"{PARTICLES}/odom", self.SE3.from_planar(along(turned), 0.0, 0.0), swing * np.eye(6)[0], stamp)
        if self.num_turns % SLOW == 0:
            self._see(PARTICLES, stamp)
        if self.num_turns % SLOW == SLOW // 2:
            for topic, picture in pictures().items():
                self._say(f"{RIG}/{topic}", picture, self.qos.LARGE)
        self.num_turns += 1
        self._operate()

    def _drive(self, topic: str, pose: Any, twist: NDArray[np.float64], stamp: int) -> None:
        frames = ("odom", "base_link")
        moved = self.messages.se3_to_odometry(pose, 1e-4 * np.eye(6), stamp, frames, twist)
        self._say(topic, moved, self.qos.SENSOR)

    def _see(self, space: str, stamp: int) -> None:
        view = self.views[self.num_turns % len(self.views)]
        info = self.messages.camera_to_info(self.camera, stamp, "camera_optical")
        self._say(f"{space}/camera_info", info, self.qos.SENSOR)
        image = self.messages.array_to_image(view, stamp, "camera_optical", "mono8")
        self._say(f"{space}/image_raw", image, self.qos.LARGE)

    def _operate(self) -> None:
        if self.speed == 0.0 and time.monotonic() - self.asked > RETRY and self.start.service_is_ready():
            if self.answer is not None and not self.answer.done():
                self.start.remove_pending_request(self.answer)
            self.asked, self.answer = time.monotonic(), self.start.call_async(self.request)
            self.counts["start called"] += 1


def along(turned: float) -> float:
    """Return how far along the street the camera is, m, at a share of its way back and forth, rad."""
    return float(1.0 + 0.5 * SWAY * (1.0 - np.cos(turned)))


def run(options: argparse.Namespace) -> Report:
    """Let it run, and report what it held."""
    log = Path("out/bench/soak.jsonl")
    log.parent.mkdir(parents=True, exist_ok=True)
    log.write_text("", encoding="utf-8")
    soak(1.0 if options.size == "quick" else 60.0, log)
    return judge(log)


def soak(minutes: float, log: Path) -> None:
    """Run the nodes for so long, and write a line for each look at them."""
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ.setdefault("ROS_DOMAIN_ID", DOMAIN)
    import rclpy

    from benchmarks.fault_drives import Course

    with tempfile.TemporaryDirectory() as name:
        course = Course(Path(name))
        rng, count, views = np.random.default_rng(0), round(SWAY_PERIOD / PERIOD), []
        for number in range(count):
            view = course.look(*course.pose(along(2.0 * np.pi * number / count)))
            views.append(np.clip(np.rint(view + rng.normal(0.0, NOISE, view.shape)), 0, 255).astype(np.uint8))
        ends: dict[str, int] = {}
        try:
            with processes(arguments(Path(name), course.map), ends) as running:
                rclpy.init()
                feeder = Feeder(views, course.camera, course.T_base_camera)
                _watch(feeder, running, minutes, log)
                feeder.node.destroy_node()
        finally:
            rclpy.try_shutdown()
            _write(log, {"ends": ends})


def _watch(feeder: Feeder, running: dict[str, subprocess.Popen[bytes]], minutes: float, log: Path) -> None:
    end = time.monotonic() + PATIENCE
    while feeder.speed == 0.0:
        feeder.live(1.0)
        if time.monotonic() > end:
            raise RuntimeError(f"path_follower: expected it to drive, found {feeder.reason!r}")
    begun = due = time.monotonic()
    while (now := time.monotonic()) - begun < 60.0 * minutes + 1.0:
        if gone := [name for name, process in running.items() if process.poll() is not None]:
            raise RuntimeError(f"{gone[0]}: expected it to run, found it ended after {now - begun:.0f} s")
        pids = {name: process.pid for name, process in running.items()}
        for name, pid in list(pids.items()):
            pids |= {f"{name}, child {number}": child for number, child in enumerate(children(pid), 1)}
        looks = {name: asdict(look(pid)) for name, pid in pids.items()}
        told = {"way": feeder.way, "counts": feeder.counts, "shared_bytes": shared_bytes(list(pids.values()))}
        _write(log, {"time": now - begun, "looks": looks} | told)
        due += SAMPLING
        feeder.live(max(due - time.monotonic(), 0.1))


def _write(log: Path, values: Any) -> None:
    with log.open("a", encoding="utf-8") as file:
        file.write(json.dumps(values) + "\n")


def slope(times: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return Theil's and Sen's slope, the median over all pairs, with the bounds of 95 per cent by Kendall's tau."""
    i, j = np.triu_indices(len(times), 1)
    slopes = np.sort((values[j] - values[i]) / (times[j] - times[i]))
    n = len(times)
    half = 1.96 * np.sqrt(n * (n - 1) * (2 * n + 5) / 18.0) / 2.0
    low, high = (int(np.clip(len(slopes) / 2.0 + off, 0, len(slopes) - 1)) for off in (-half, half))
    return float(np.median(slopes)), float(slopes[low]), float(slopes[high])


def judge(log: Path) -> Report:
    """Report what the samples in a file say, also those of a run that was cut off."""
    lines = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines() if line.endswith("}")]
    samples = [line for line in lines if "looks" in line]
    warm = min(WARM_UP, samples[-1]["time"] / 3.0)
    used = [sample for sample in samples if sample["time"] >= warm]
    times, names = np.array([sample["time"] for sample in used]), list(used[0]["looks"])
    report, rows, growths = Report("soak", notes=[__doc__ or ""]), [], []
    for name in names:
        looks = [Look(**sample["looks"][name]) for sample in used]
        memory = np.array([one.anonymous for one in looks]) / 1024.0
        middle, low, high = (3600.0 * found for found in slope(times, memory))
        growths.append(middle)
        counts = [(looks[0].handles, looks[-1].handles), (looks[0].threads, looks[-1].threads)]
        share = 100.0 * (looks[-1].cpu - looks[0].cpu) / (times[-1] - times[0])
        told = (f"{memory[0]:.1f} – {memory[-1]:.1f}", f"{middle:.2f} ({low:.2f} to {high:.2f})")
        rows.append((name, *told, *(f"{first} – {last}" for first, last in counts), f"{share:.1f}"))
        for what, (first, last) in zip(("descriptors", "threads"), counts, strict=True):
            report.bounds.append(Bound(f"{name}: {what}, more at the end", 0, last - first, ""))
    headline = Headline("times and memory", f"{len(names)} processes, {times[-1] / 60.0:.0f} minutes")
    report.bounds.append(
        Bound("growth of memory, largest of all processes", 1.0, max(growths), "MB/h", headline=headline)
    )
    grown = used[-1]["shared_bytes"] - used[0]["shared_bytes"]
    report.bounds.append(Bound("bytes in /dev/shm, more at the end", 0, grown, ""))
    columns = ("process", "memory, MB", "growth, MB/h (95 %)", "descriptors", "threads", "CPU, %")
    title = f"First and last of {(times[-1] - times[0]) / 60.0:.0f} min, after {warm / 60.0:.0f} min of warming up"
    report.tables.append(Table(title, columns, rows))
    ends = next((line["ends"] for line in lines if "ends" in line), "none yet")
    report.notes.append(f"Driven {samples[-1]['way']:.0f} m; {samples[-1]['counts']}; exit codes {ends}.")
    return report
