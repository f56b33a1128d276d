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
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Bound, Headline, Report, Table

HELP = "an hour of the real processes at 10 Hz: memory, descriptors, threads, shared memory"
DOMAIN = "71"
PERIOD, SLOW = 0.1, 10  # s between two turns of the feeder; turns between two inputs of what is fed slowly
SAMPLING = 10.0  # s between two looks at the processes: what wanders is told from what grows by their number
WARM_UP = 10.0  # min in which caches fill; at most a third of the run
RADIUS = 20.0  # m of the circle that is driven
SWAY, SWAY_PERIOD = 6.0, 20.0  # m and s of the camera's way back and forth: at most 0.94 m/s
NOISE = 1.2  # grey levels
NICE = 5
PATIENCE = 120.0  # s until it drives, where kernels may be compiled first
RETRY = 2.0  # s between two calls of start
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


# --- what is looked at
@dataclass(frozen=True)
class Look:
    """What a process held at one time: anonymous and private memory in kB, descriptors, threads, CPU in s."""

    anonymous: int
    private: int
    handles: int
    threads: int
    cpu: float


def look(pid: int) -> Look:
    """Return what a process holds."""
    process = Path(f"/proc/{pid}")
    rollup = _numbers(process / "smaps_rollup")
    stat = (process / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return Look(
        rollup["Anonymous"],
        rollup["Private_Clean"] + rollup["Private_Dirty"],
        len(os.listdir(process / "fd")),
        int(stat[17]),
        (int(stat[11]) + int(stat[12])) / os.sysconf("SC_CLK_TCK"),
    )


def _numbers(path: Path) -> dict[str, int]:
    lines = path.read_text(encoding="utf-8").splitlines()
    return {line.partition(":")[0]: int(line.split()[1]) for line in lines if line.endswith(" kB")}


def children(pid: int) -> list[int]:
    """Return the processes beneath a process."""
    found = []
    for task in os.listdir(f"/proc/{pid}/task"):
        for child in Path(f"/proc/{pid}/task/{task}/children").read_text(encoding="ascii").split():
            found += [int(child), *children(int(child))]
    return found


def shared_files(pids: list[int]) -> dict[str, int]:
    """Return the files of /dev/shm that processes have mapped, with their sizes in bytes."""
    names = set()
    for pid in pids:
        for line in Path(f"/proc/{pid}/maps").read_text(encoding="utf-8").splitlines():
            if "/dev/shm/" in line:
                names.add(line[line.index("/dev/shm/") :])
    return {name: os.stat(name).st_size if os.path.exists(name) else 0 for name in names}


# --- what is started
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
    stitcher = rig_in(folder)
    parameters: dict[str, dict[str, Any]] = {
        "path_follower": {"trajectory": folder / "path.csv", "path.is_closed": "true"},
        "command_guard": {},
        "dense_localizer": {"map": street},
        "mcl_depth": {"cloud": street, "input.timeout_s": 3.0},
        "sphere_stitcher": stitcher,
        "bag_recorder": {"output": folder / "bag", "topics": f"'{TOPICS}'"},
    }
    remaps = {
        "path_follower": ["cmd_vel:=cmd_vel_in"],
        "dense_localizer": [f"__ns:={EYES}"],
        "mcl_depth": [f"__ns:={PARTICLES}", "/tf:=/particles/tf"],
        "sphere_stitcher": [f"__ns:={RIG}"],
    }
    return {
        name: [
            *(word for key, value in values.items() for word in ("-p", f"{key}:={value}")),
            *(word for rule in remaps.get(name, []) for word in ("-r", rule)),
        ]
        for name, values in parameters.items()
    }


# --- what feeds it
class Feeder:
    """The base, its sensors and the operator, who starts it again where it has stopped."""

    def __init__(self, views: list[NDArray[np.uint8]], camera: Any, T_base_camera: Any) -> None:
        import rclpy
        from geometry_msgs.msg import Twist
        from sphere_nav_msgs.msg import FollowerStatus, LocalizationStatus
        from std_srvs.srv import Trigger
        from tf2_msgs.msg import TFMessage

        from benchmarks.abuse.nodes import pictures
        from sphere_nav.geometry import SE3
        from sphere_nav.ros import conversions, qos

        self.node, self.qos = rclpy.create_node("base"), qos
        self.publishers: dict[str, Any] = {}
        self.views, self.camera, self.pictures = views, camera, pictures
        self.node.create_subscription(Twist, "cmd_vel", self._obey, qos.COMMAND)
        self.node.create_subscription(FollowerStatus, "path_follower/status", self._hear, qos.STATE)
        self.counts: dict[str, int] = {}
        for space in (EYES, PARTICLES):
            count = partial(self._count, space)
            self.node.create_subscription(LocalizationStatus, f"{space}/status", count, qos.STATE)
        self.start, self.request = self.node.create_client(Trigger, "path_follower/start"), Trigger.Request()
        self.pose = SE3.identity()
        self.speed = self.yaw_rate = self.way = 0.0
        self.num_turns, self.num_starts, self.moved = 0, 0, time.monotonic()
        self.answer: Any = None
        self.asked, self.reason = 0.0, ""
        self.reasons: dict[str, int] = {}
        mounts = {"camera_optical": T_base_camera, "laser": SE3.identity()}
        stamp = time.time_ns()
        frames = [conversions.se3_to_transform(T, stamp, "base_link", name) for name, T in mounts.items()]
        self._say("/tf_static", TFMessage(transforms=frames), qos.TF_STATIC)

    def _obey(self, message: Any) -> None:
        self.speed, self.yaw_rate = message.linear.x, message.angular.z

    def _hear(self, message: Any) -> None:
        if message.reason and message.reason != self.reason:
            self.reasons[message.reason] = self.reasons.get(message.reason, 0) + 1
        self.reason = message.reason

    def _count(self, space: str, message: Any) -> None:
        what = f"{space} {message.state}"
        self.counts[what] = self.counts.get(what, 0) + 1

    def _say(self, topic: str, message: Any, profile: Any) -> None:
        if topic not in self.publishers:
            self.publishers[topic] = self.node.create_publisher(type(message), topic, profile)
        self.publishers[topic].publish(message)

    def live(self, seconds: float) -> None:
        """Let time pass."""
        import rclpy

        end = time.monotonic() + seconds
        due = time.monotonic()
        while time.monotonic() < end:
            if time.monotonic() >= due:
                due = max(due + PERIOD, time.monotonic() - PERIOD)
                self.turn()
            rclpy.spin_once(self.node, timeout_sec=max(min(due, end) - time.monotonic(), 0.001))

    def turn(self) -> None:
        """Move, and say once what the sensors see."""
        from sensor_msgs.msg import LaserScan
        from std_msgs.msg import Bool

        from sphere_nav.geometry import SE3
        from sphere_nav.localization.status import State, Status
        from sphere_nav.ros import conversions

        elapsed, self.moved = time.monotonic() - self.moved, time.monotonic()
        step = SE3.from_planar(self.speed * elapsed, 0.0, self.yaw_rate * elapsed)
        self.pose, self.way = self.pose @ step, self.way + abs(self.speed) * elapsed
        stamp, state, covariance = time.time_ns(), self.qos.STATE, 1e-4 * np.eye(6)
        self._say("emergency_stop", Bool(data=False), state)
        self._say("status", conversions.status_to_message(Status(State.TRACKING), stamp, "map"), state)
        self._say("pose", conversions.se3_to_pose_with_covariance(self.pose, covariance, stamp, "map"), state)
        twist = np.array([self.speed, 0.0, 0.0, 0.0, 0.0, self.yaw_rate])
        odometry = conversions.se3_to_odometry(self.pose, covariance, stamp, ("odom", "base_link"), twist)
        self._say("odom", odometry, self.qos.SENSOR)
        ranges = (15.0 + 0.01 * np.sin(np.arange(360) + self.num_turns)).tolist()
        scan = LaserScan(ranges=ranges, angle_min=-np.pi, angle_max=np.pi, angle_increment=2 * np.pi / 360)
        scan.range_min, scan.range_max, scan.header.frame_id = 0.1, 30.0, "laser"
        scan.header.stamp.sec, scan.header.stamp.nanosec = divmod(stamp, 10**9)
        self._say("scan", scan, self.qos.SENSOR)
        self._see(EYES, stamp)
        turned = 2.0 * np.pi * self.num_turns / len(self.views)
        sway, swing = SE3.from_planar(along(turned), 0.0, 0.0), np.pi * SWAY / SWAY_PERIOD * np.sin(turned)
        moved = conversions.se3_to_odometry(sway, covariance, stamp, ("odom", "base_link"), swing * np.eye(6)[0])
        self._say(f"{PARTICLES}/odom", moved, self.qos.SENSOR)
        if self.num_turns % SLOW == 0:
            self._see(PARTICLES, stamp)
        if self.num_turns % SLOW == SLOW // 2:
            for topic, picture in self.pictures().items():
                self._say(f"{RIG}/{topic}", picture, self.qos.LARGE)
        self.num_turns += 1
        self._operate()

    def _see(self, space: str, stamp: int) -> None:
        from sphere_nav.ros import conversions

        view = self.views[self.num_turns % len(self.views)]
        info = conversions.camera_to_info(self.camera, stamp, "camera_optical")
        self._say(f"{space}/camera_info", info, self.qos.SENSOR)
        image = conversions.array_to_image(view, stamp, "camera_optical", "mono8")
        self._say(f"{space}/image_raw", image, self.qos.LARGE)

    def _operate(self) -> None:
        if self.speed == 0.0 and time.monotonic() - self.asked > RETRY and self.start.service_is_ready():
            if self.answer is not None and not self.answer.done():
                self.start.remove_pending_request(self.answer)
            self.asked, self.answer = time.monotonic(), self.start.call_async(self.request)
            self.num_starts += 1


def along(turned: float) -> float:
    """Return how far along the street the camera is, m, at a share of its way back and forth, rad."""
    return float(1.0 + 0.5 * SWAY * (1.0 - np.cos(turned)))


def draw(folder: Path) -> tuple[Path, list[NDArray[np.uint8]], Any, Any]:
    """Return a street's map, what a camera sees of it going back and forth, with noise; the camera and its place."""
    from benchmarks.fault_drives import Course

    course = Course(folder)
    rng, count = np.random.default_rng(0), round(SWAY_PERIOD / PERIOD)
    views = []
    for number in range(count):
        view = course.look(*course.pose(along(2.0 * np.pi * number / count)))
        views.append(np.clip(np.rint(view + rng.normal(0.0, NOISE, view.shape)), 0, 255).astype(np.uint8))
    return course.map, views, course.camera, course.T_base_camera


# --- the benchmark
def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--minutes", type=float, help="length of the run (2, full 60)")
    parser.add_argument("--log", type=Path, metavar="F", help="only report the samples in this file, of a run before")


def run(options: argparse.Namespace) -> Report:
    """Let it run, and report what it held."""
    if options.log is not None:
        return judge(options.log)
    log = Path("out/bench/soak.jsonl")
    log.parent.mkdir(parents=True, exist_ok=True)
    soak(options.minutes or (2.0 if options.size == "quick" else 60.0), log)
    return judge(log)


def soak(minutes: float, log: Path) -> None:
    """Run the nodes for so long, and write a line for each look at them."""
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ.setdefault("ROS_DOMAIN_ID", DOMAIN)
    import rclpy

    with tempfile.TemporaryDirectory() as name, open(log, "w", encoding="utf-8") as file:
        street, views, camera, mount = draw(Path(name))
        ends: dict[str, int] = {}
        try:
            with processes(arguments(Path(name), street), ends) as running:
                rclpy.init()
                feeder = Feeder(views, camera, mount)
                _watch(feeder, running, minutes, file)
                feeder.node.destroy_node()
        finally:
            rclpy.try_shutdown()
            _write(file, {"ends": ends})


def _watch(feeder: Feeder, running: dict[str, subprocess.Popen[bytes]], minutes: float, file: TextIO) -> None:
    end = time.monotonic() + PATIENCE
    while feeder.speed == 0.0:
        feeder.live(1.0)
        if time.monotonic() > end:
            raise RuntimeError(f"path_follower: expected it to drive, found {feeder.reason!r}")
    begun, due = time.monotonic(), time.monotonic()
    while (now := time.monotonic()) - begun < 60.0 * minutes + 1.0:
        gone = [name for name, process in running.items() if process.poll() is not None]
        if gone:
            raise RuntimeError(f"{gone[0]}: expected it to run, found it ended after {now - begun:.0f} s")
        pids = {name: process.pid for name, process in running.items()}
        for name, pid in list(pids.items()):
            pids |= {f"{name}, child {number}": child for number, child in enumerate(children(pid), 1)}
        shared = shared_files(list(pids.values()))
        sample = {
            "time": now - begun,
            "looks": {name: asdict(look(pid)) for name, pid in pids.items()},
            "shared": len(shared),
            "shared_bytes": sum(shared.values()),
            "way": feeder.way,
            "starts": feeder.num_starts,
            "reasons": feeder.reasons,
            "states": feeder.counts,
        }
        _write(file, sample)
        due += SAMPLING
        feeder.live(max(due - time.monotonic(), 0.1))


def _write(file: TextIO, values: Any) -> None:
    file.write(json.dumps(values) + "\n")
    file.flush()


def slope(times: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return Theil's and Sen's slope, the median over all pairs, with the bounds of 95 per cent by Kendall's tau."""
    i, j = np.triu_indices(len(times), 1)
    slopes = np.sort((values[j] - values[i]) / (times[j] - times[i]))
    n = len(times)
    half = 1.96 * np.sqrt(n * (n - 1) * (2 * n + 5) / 18.0) / 2.0
    middle = len(slopes) / 2.0
    low, high = (int(np.clip(place, 0, len(slopes) - 1)) for place in (middle - half, middle + half))
    return float(np.median(slopes)), float(slopes[low]), float(slopes[high])


def judge(log: Path) -> Report:
    """Report what the samples in a file say, also those of a run that was cut off."""
    lines = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines() if line.endswith("}")]
    samples = [line for line in lines if "looks" in line]
    warm = min(60.0 * WARM_UP, samples[-1]["time"] / 3.0)
    used = [sample for sample in samples if sample["time"] >= warm]
    times = np.array([sample["time"] for sample in used])
    report, rows = Report("soak", notes=[__doc__ or ""]), []
    for name in used[0]["looks"]:
        looks = [Look(**sample["looks"][name]) for sample in used]
        row, bounds = _judge_one(name, times, looks)
        rows.append(row)
        report.bounds += bounds
    growth = max(bound.measured for bound in report.bounds if bound.unit == "MB/h")
    told = Headline("times and memory", f"{len(used[0]['looks'])} processes, {times[-1] / 60.0:.0f} minutes")
    report.bounds.append(Bound("growth of memory, largest of all processes", 1.0, growth, "MB/h", headline=told))
    for key, what in (("shared", "files in /dev/shm"), ("shared_bytes", "bytes in /dev/shm")):
        report.bounds.append(Bound(f"{what}, more at the end", 0, used[-1][key] - used[0][key], ""))
    columns = ("process", "memory, MB", "growth, MB/h (95 %)", "descriptors (most)", "threads (most)", "CPU, %")
    title = f"First and last of {(times[-1] - times[0]) / 60.0:.0f} min, after {warm / 60.0:.0f} min of warming up"
    report.tables.append(Table(title, columns, rows))
    last, ends = samples[-1], next((line["ends"] for line in lines if "ends" in line), "none yet")
    report.notes.append(
        f"Driven {last['way']:.0f} m, start called {last['starts']} times, stops {last['reasons']}; states of the "
        f"images {last['states']}; /dev/shm {last['shared']} files of {last['shared_bytes'] / 2**20:.1f} MB; exit "
        f"codes {ends}."
    )
    return report


def _judge_one(name: str, times: NDArray[np.float64], looks: list[Look]) -> tuple[tuple[str, ...], list[Bound]]:
    first, last = looks[0], looks[-1]
    memory = np.array([one.anonymous for one in looks]) / 1024.0
    middle, low, high = (3600.0 * found for found in slope(times, memory))
    handles, threads = [one.handles for one in looks], [one.threads for one in looks]
    row = (
        name,
        f"{memory[0]:.1f} – {memory[-1]:.1f}",
        f"{middle:.2f} ({low:.2f} to {high:.2f})",
        f"{handles[0]} – {handles[-1]} ({max(handles)})",
        f"{threads[0]} – {threads[-1]} ({max(threads)})",
        f"{100.0 * (last.cpu - first.cpu) / (times[-1] - times[0]):.1f}",
    )
    return row, [
        Bound(f"{name}: growth of memory", 1.0, middle, "MB/h"),
        Bound(f"{name}: descriptors, more at the end", 0, handles[-1] - handles[0], ""),
        Bound(f"{name}: threads, more at the end", 0, threads[-1] - threads[0], ""),
    ]
