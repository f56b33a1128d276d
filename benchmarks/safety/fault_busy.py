"""Faults of real processes over real DDS: alone, and while all that can be asked of the follower is asked at once.

The base keeps the last command, as one without a time-out of its own does. Poses come ten times a second. Busy, from
when it drives: calls, parameters, paths of 20,000 and 1,000,000 poses, transforms and scans of megabytes, as fast as
two processes can send them; loaded: four processes a core that do nothing but compute; deaf: a listener of all that
the follower publishes hangs, and acknowledges nothing more.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.synchronize import Event as EventOfProcesses
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped, Twist
from lifecycle_msgs.srv import GetState
from nav_msgs.msg import Path as PathMessage
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.serialization import serialize_message
from sensor_msgs.msg import LaserScan
from sphere_nav_msgs.srv import LoadTrajectory
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from benchmarks.base import SETTLE, Base, write_straight
from benchmarks.report import Bound, Headline, Report, Table
from path_follower.ros.loop_process import take_precedence
from sphere_nav.geometry import SE3
from sphere_nav.ros import qos
from sphere_nav.ros.conversions import se3_to_transform
from sphere_nav_tools.cli.processes import node_command

RUN = 2.0  # s of driving before a fault, in which the silence of commands is measured
BASE_PRIORITY = 5  # real time, below the loops it is driven by
AFTER = 3.0  # s in which zero must come
ENDING = 1.0  # s for a process to end by itself
LISTEN = """
import rclpy
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Path
from rclpy.qos import QoSProfile
from sphere_nav_msgs.msg import FollowerStatus, TrackingError

rclpy.init()
node = rclpy.create_node("deaf")
kinds = {"cmd_vel": Twist, "tracking_error": TrackingError, "path_follower/status": FollowerStatus}
for topic, kind in kinds.items():
    node.create_subscription(kind, topic, lambda message: None, QoSProfile(depth=10))
rclpy.spin_once(node, timeout_sec=0.5)
print(flush=True)
rclpy.spin(node)
"""


Seen = tuple[float, float, str]  # of a drive: silence of commands before the fault, zero after it, in s; the reason


def lie(base: Base, name: str, value: Any) -> None:
    """Change what the base says from now on, and say it at once."""
    setattr(base, name, value)
    base.speak()


def second(base: Base, topic: str, kind: Any) -> None:
    """Let another node publish a topic."""
    other = rclpy.create_node("second")
    other.create_publisher(kind, topic, 1)
    base.others.append(other)


def faults() -> dict[str, Callable[[Base, Any], None]]:
    """Return the faults by name; each gets the base and the process of the follower."""
    return {
        "emergency stop": lambda base, _: lie(base, "is_pressed", True),
        "localiser silent": lambda base, _: lie(base, "is_silent", True),
        "localiser's status silent": lambda base, _: lie(base, "has_status", False),
        "localiser LOST": lambda base, _: lie(base, "state", "LOST"),
        "pose of another frame": lambda base, _: lie(base, "frame", "odom"),
        "pose that is no number": lambda base, _: lie(base, "aside", float("nan")),
        "pose 3 m aside": lambda base, _: lie(base, "aside", 3.0),
        "second publisher of the pose": lambda base, _: second(base, "pose", PoseWithCovarianceStamped),
        "second publisher of cmd_vel": lambda base, _: second(base, "cmd_vel", Twist),
        "front killed": lambda _, process: os.kill(front_of(process.pid), signal.SIGKILL),
        "SIGINT": lambda _, process: process.send_signal(signal.SIGINT),
        "SIGTERM": lambda _, process: process.send_signal(signal.SIGTERM),
    }


def front_of(pid: int) -> int:
    """Return the process beneath a loop."""
    return int(Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()[0])


def observe(name: str, gate: EventOfProcesses) -> Seen:
    """Drive, let the crowd begin and then a fault, and look what comes."""
    with tempfile.TemporaryDirectory() as folder:
        path = write_straight(Path(folder))
        words = node_command("path_follower", "--ros-args", "-p", f"trajectory:={path}", "--log-level", "fatal")
        process, base = subprocess.Popen(words), Base()
        # as a computer of its own would serve the base, but not what it starts
        take_precedence(os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, BASE_PRIORITY)
        try:
            base.drive_off()
            gate.set()
            base.live(SETTLE)
            base.commands.clear()
            base.live(RUN)
            silence = float(np.diff([when for when, _ in base.commands]).max())
            base.reason, begun = "", time.monotonic()
            faults()[name](base, process)
            base.live(AFTER, lambda: base.speed == 0.0 and bool(base.reason))
            zero = base.commands[-1][0] - begun if base.speed == 0.0 else float("inf")
            base.live(0.5)
            zero = zero if base.speed == 0.0 else float("inf")
            return silence, zero, base.reason
        finally:
            gate.clear()
            for node in base.others:
                node.destroy_node()
            base.close()
            process.kill()
            process.wait()


# --- what keeps the machine busy, or the listeners waiting
@contextmanager
def crowd(*targets: Callable[[EventOfProcesses], None]) -> Iterator[EventOfProcesses]:
    """Run functions in processes of their own; each goes on while the event that this yields is set."""
    context = multiprocessing.get_context("spawn")
    gate = context.Event()
    processes = [context.Process(target=target, args=(gate,), daemon=True) for target in targets]
    for process in processes:
        process.start()
    try:
        yield gate
    finally:
        for process in processes:
            process.terminate()  # who has children ends them
            process.join(ENDING)
            process.kill()
            process.join()


def compute(gate: EventOfProcesses) -> None:
    """Keep a core busy."""
    while gate.wait():
        for _ in range(100_000):
            pass


def hang(gate: EventOfProcesses) -> None:
    """Stop a process that listens reliably, as a debugger or a full disk would."""
    children: list[subprocess.Popen[bytes]] = []

    def end(*_: object) -> None:
        for child in children:
            child.kill()
            child.wait()
        sys.exit(0)

    signal.signal(signal.SIGTERM, end)
    while gate.wait():
        with subprocess.Popen([sys.executable, "-P", "-c", LISTEN], stdout=subprocess.PIPE) as child:
            children[:] = [child]
            assert child.stdout is not None
            child.stdout.readline()
            child.send_signal(signal.SIGSTOP)
            while gate.is_set():
                time.sleep(0.05)
            child.kill()


def big_path(count: int) -> bytes:
    """Return a nav_msgs/Path of so many poses in CDR, without an object for each."""
    pose = np.zeros(1, dtype=np.dtype([("stamp", "<i4", 2), ("size", "<u4"), ("frame", "S4"), ("pose", "<f8", 7)]))
    pose["size"], pose["frame"] = 4, b"map"
    poses = np.repeat(pose, count)
    poses["pose"][:, 0] = np.arange(count)
    poses["pose"][:, 6] = 1.0
    first = poses[0].tobytes()
    head = struct.pack("<4xiiI4sI", 0, 0, 4, b"map", count).replace(b"\0\0\0\0", b"\0\1\0\0", 1)
    return head + first[:16] + b"\0\0\0\0" + first[16:] + poses[1:].tobytes()


def flood_topics(gate: EventOfProcesses) -> None:
    """Send paths, transforms and scans of megabytes without end."""
    rclpy.init()
    node = rclpy.create_node("flood_of_topics")
    frames = [se3_to_transform(SE3.identity(), 0, "base_link", f"frame_{k}") for k in range(200)]
    scan = LaserScan(ranges=[5.0] * 250_000, angle_increment=1e-5, range_min=0.1, range_max=30.0)
    transforms = serialize_message(TFMessage(transforms=frames))
    items = [
        (node.create_publisher(PathMessage, "reference_path", qos.LATCHED), big_path(20_000)),
        (node.create_publisher(TFMessage, "/tf_static", qos.TF_STATIC), transforms),
        (node.create_publisher(TFMessage, "/tf", qos.TF), transforms),
        (node.create_publisher(LaserScan, "scan", qos.SENSOR), serialize_message(scan)),
    ]
    largest, turn = big_path(1_000_000), 0
    while gate.wait():
        turn += 1
        for publisher, data in items:
            publisher.publish(data)
        if turn % 200 == 0:
            items[0][0].publish(largest)
        time.sleep(0.001)


def flood_services(gate: EventOfProcesses) -> None:
    """Call every service of the follower that leaves it driving, without awaiting answers."""
    rclpy.init()
    node = rclpy.create_node("flood_of_services")
    text = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="x" * 1_000_000)
    many = [Parameter(name=f"p{k}", value=ParameterValue(type=2, integer_value=k)) for k in range(5000)]
    requests: list[tuple[Any, str, Any]] = [
        (SetParameters, "set_parameters", SetParameters.Request(parameters=many)),
        (SetParameters, "set_parameters", SetParameters.Request(parameters=[Parameter(name="trajectory", value=text)])),
        (GetParameters, "get_parameters", GetParameters.Request(names=[f"p{k}" for k in range(5000)])),
        (ListParameters, "list_parameters", ListParameters.Request()),
        (GetState, "get_state", GetState.Request()),
        (LoadTrajectory, "load_trajectory", LoadTrajectory.Request(path="/dev/zero")),
        (Trigger, "resume", Trigger.Request()),
        (Trigger, "start", Trigger.Request()),
    ]
    clients = [(node.create_client(kind, f"path_follower/{name}"), request) for kind, name, request in requests]
    while gate.wait():
        for client, request in clients:
            if client.service_is_ready():
                client.remove_pending_request(client.call_async(request))
            time.sleep(0.001)


CONDITIONS: dict[str, tuple[Callable[[EventOfProcesses], None], ...]] = {
    "alone": (),
    "busy": (flood_topics, flood_services),
    "loaded": (compute,) * 4 * (os.cpu_count() or 1),
    "deaf": (hang,),
}


def run(options: argparse.Namespace) -> Report:
    """Suffer each fault in each condition, or every third in the first two."""
    is_quick = options.size == "quick"
    runs, conditions = (1, list(CONDITIONS)[:2]) if is_quick else (5, list(CONDITIONS))
    chosen = list(faults())[:: 3 if is_quick else 1]
    seen, rows, bounds = dict[str, dict[str, list[Seen]]](), [], []
    for name in conditions:
        with crowd(*CONDITIONS[name]) as gate:
            seen[name] = {fault: [observe(fault, gate) for _ in range(runs)] for fault in chosen}
    for fault in chosen:
        every = [seen[name][fault] for name in conditions]
        reasons = sorted({reason or "–" for drives in every for *_, reason in drives})
        zeros = [f"{max(zero for _, zero, _ in drives):.2f}" for drives in every]
        rows.append((fault, ", ".join(reasons), *zeros))
    of = Headline("time to zero", f"{len(rows)} faults of real processes over DDS")
    for name in conditions:
        drives = [one for several in seen[name].values() for one in several]
        stops = [zero for _, zero, _ in seen[name]["emergency stop"]]
        never, silence = sum(math.isinf(zero) for _, zero, _ in drives), max(drives)[0]
        bounds += [
            Bound(f"longest silence of commands, {name}", 0.12, silence, "s", headline=of),
            Bound(f"emergency stop to zero, {name}", 0.4, max(stops), "s"),
            Bound(f"faults that did not end in zero, {name}", 0, never, "", headline=of),
        ]
    columns = ("fault", "reason", *(f"{name}: zero after, max [s]" for name in conditions))
    return Report("fault_busy", [Table("Real processes", columns, rows)], bounds)
