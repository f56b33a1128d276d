"""Twenty minutes of the real processes over DDS at 10 Hz: what do memory, descriptors, threads and shared memory do?

A base drives a circle behind follower and guard; a localiser sees images drawn along a street, back and forth; the
particle filter and the stitcher are fed once a second; a recorder writes what is small. Memory is what is anonymous
(smaps_rollup), the least of ten looks within 1.3 s: what a process holds, not what an image needs for a moment. Its
growth is the median slope of all pairs of samples.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tf2_msgs.msg import TFMessage

from benchmarks.abuse.nodes import pictures, rig_in
from benchmarks.base import Base
from benchmarks.fault_drives import Course
from benchmarks.report import Bound, Headline, Report, Table
from sphere_nav.geometry import SE3
from sphere_nav.ros import conversions, qos
from sphere_nav_tools.cli.processes import Processes, node_command
from worlds.patience import family

SLOW, NUM_VIEWS = 10, 200  # turns between two inputs of what is fed slowly; views of the way back and forth
SAMPLING, WARM_UP = 10.0, 600.0  # s between two samples; in which caches fill, at most a third of the run
LOOKS, PAUSE = 10, 0.13  # at the memory for one sample, s between them: out of step with the 10 Hz of the images
RADIUS, SWAY, NOISE = 20.0, 6.0, 1.2  # m of the circle; m of the camera's way; grey levels
WHATS = ("anonymous", "handles", "threads", "cpu")  # of a process
EYES, PARTICLES, RIG = "/eyes", "/particles", "/rig"  # namespaces of what sees
TOPICS = f"'pose status scan cmd_vel cmd_vel_in path_follower/status /tf /diagnostics {EYES}/pose {EYES}/status'"
NODES = {  # their remappings
    "path_follower": ["cmd_vel:=cmd_vel_in"],
    "command_guard": [],
    "dense_localizer": [f"__ns:={EYES}"],
    "mcl_depth": [f"__ns:={PARTICLES}", "/tf:=/particles/tf"],
    "sphere_stitcher": [f"__ns:={RIG}"],
    "bag_recorder": [],
}


def look(pid: int) -> dict[str, float]:
    """Return what a process holds: anonymous memory in kB, descriptors, threads, CPU in s."""
    process = Path(f"/proc/{pid}")
    rollup = (process / "smaps_rollup").read_text(encoding="utf-8")
    stat = (process / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    seconds = (int(stat[11]) + int(stat[12])) / os.sysconf("SC_CLK_TCK")
    anonymous = int(rollup.partition("\nAnonymous:")[2].split()[0])
    handles = len(os.listdir(process / "fd"))
    return {"anonymous": anonymous, "handles": handles, "threads": int(stat[17]), "cpu": seconds}


def shared_bytes(pids: list[int]) -> int:
    """Return the bytes of /dev/shm that processes have mapped."""
    maps = [Path(f"/proc/{pid}/maps").read_text(encoding="utf-8").splitlines() for pid in pids]
    names = {line[line.index("/dev/shm/") :] for lines in maps for line in lines if "/dev/shm/" in line}
    return sum(os.stat(name).st_size for name in names if os.path.exists(name))


class Feeder(Base):
    """The base on its circle, its sensors, and what others see."""

    def __init__(self, views: list[NDArray[np.uint8]], camera: Any, T_base_camera: Any) -> None:
        super().__init__()
        self.publishers: dict[str, Any] = {}
        self.views, self.camera, self.num_turns = views, camera, 0
        mounts = {"camera_optical": T_base_camera, "laser": SE3.identity()}
        frames = [conversions.se3_to_transform(T, time.time_ns(), "base_link", name) for name, T in mounts.items()]
        self._say("/tf_static", TFMessage(transforms=frames), qos.TF_STATIC)

    def place(self) -> Any:
        """Return where the base is."""
        turned = self.x / RADIUS
        return SE3.from_planar(RADIUS * np.sin(turned), RADIUS * (1.0 - np.cos(turned)), turned)

    def speak(self) -> None:
        """Say once what the sensors see."""
        super().speak()
        stamp = time.time_ns()
        self.scan(15.0 + 0.01 * np.sin(np.arange(360) + self.num_turns), 2 * np.pi / 360)
        self._see(EYES, stamp)
        moved = SE3.from_planar(along(self.num_turns), 0.0, 0.0)
        odometry = conversions.se3_to_odometry(moved, 1e-4 * np.eye(6), stamp, ("odom", "base_link"), np.zeros(6))
        self._say(f"{PARTICLES}/odom", odometry, qos.SENSOR)
        if self.num_turns % SLOW == 0:
            self._see(PARTICLES, stamp)
            for topic, picture in pictures().items():
                self._say(f"{RIG}/{topic}", picture, qos.LARGE)
        self.num_turns += 1

    def _say(self, topic: str, message: Any, profile: Any) -> None:
        if topic not in self.publishers:
            self.publishers[topic] = self.node.create_publisher(type(message), topic, profile)
        self.publishers[topic].publish(message)

    def _see(self, space: str, stamp: int) -> None:
        view = self.views[self.num_turns % len(self.views)]
        self._say(f"{space}/camera_info", conversions.camera_to_info(self.camera, stamp, "camera_optical"), qos.SENSOR)
        self._say(f"{space}/image_raw", conversions.array_to_image(view, stamp, "camera_optical", "mono8"), qos.LARGE)


def along(turn: int) -> float:
    """Return how far along the street the camera is, m."""
    return float(1.0 + 0.5 * SWAY * (1.0 - np.cos(2.0 * np.pi * turn / NUM_VIEWS)))


def run(options: argparse.Namespace) -> Report:
    """Let the nodes run, write a line for each look at them, and report what they held."""
    log, minutes = Path("out/bench/soak.jsonl"), 1.0 if options.size == "quick" else 20.0
    log.parent.mkdir(parents=True, exist_ok=True)
    log.write_text("", encoding="utf-8")
    folder, rng, views = options.folder, np.random.default_rng(0), []
    course = Course(folder)
    for number in range(NUM_VIEWS):
        view = course.look(*course.pose(along(number)))
        views.append(np.clip(np.rint(view + rng.normal(0.0, NOISE, view.shape)), 0, 255).astype(np.uint8))
    turns = np.linspace(0.0, 40.0 * np.pi, 8000)  # more rounds than are driven
    circle = [f"{RADIUS * np.sin(turn):.4f},{RADIUS * (1.0 - np.cos(turn)):.4f}" for turn in turns]
    (folder / "path.csv").write_text("\n".join(circle), encoding="utf-8")
    parameters: dict[str, dict[str, Any]] = {
        "path_follower": {"trajectory": folder / "path.csv"},
        "dense_localizer": {"map": course.map},
        "mcl_depth": {"cloud": course.map, "input.timeout_s": 3.0},
        "sphere_stitcher": rig_in(folder),
        "bag_recorder": {"output": folder / "bag", "topics": TOPICS},
    }
    with Processes(folder) as nodes:
        running = {name: nodes.begin(name, _command(name, parameters.get(name, {}))) for name in NODES}
        feeder = Feeder(views, course.camera, course.T_base_camera)
        try:
            _watch(feeder, running, minutes, log)
        finally:
            feeder.close()
    return judge(log)


def _command(node: str, parameters: dict[str, Any]) -> list[str]:
    given = [word for key, value in parameters.items() for word in ("-p", f"{key}:={value}")]
    return node_command(node, "--ros-args", *given, *(word for rule in NODES[node] for word in ("-r", rule)))


def _watch(feeder: Feeder, running: dict[str, subprocess.Popen[bytes]], minutes: float, log: Path) -> None:
    feeder.drive_off()
    begun = due = time.monotonic()
    while (now := time.monotonic()) - begun < 60.0 * minutes + 1.0:
        if gone := [name for name, process in running.items() if process.poll() is not None]:
            raise RuntimeError(f"{gone[0]}: expected it to run, found it ended after {now - begun:.0f} s")
        pids = {f"{name} {n or ''}".strip(): pid for name, p in running.items() for n, pid in enumerate(family(p.pid))}
        looks = {name: look(pid) for name, pid in pids.items()}
        for _ in range(LOOKS - 1):
            feeder.live(PAUSE)
            for name, pid in pids.items():
                looks[name]["anonymous"] = min(looks[name]["anonymous"], look(pid)["anonymous"])
        told = {"way": feeder.x, "reason": feeder.reason, "shared_bytes": shared_bytes(list(pids.values()))}
        with log.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"time": now - begun, "looks": looks} | told) + "\n")
        due += SAMPLING
        feeder.live(max(due - time.monotonic(), 0.1))


def slope(times: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """Return Theil's and Sen's slope, the median over all pairs."""
    i, j = np.triu_indices(len(times), 1)
    return float(np.median((values[j] - values[i]) / (times[j] - times[i])))


def judge(log: Path) -> Report:
    """Report what the samples in a file say, also those of a run that was cut off."""
    samples = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines() if line.endswith("}")]
    warm = min(WARM_UP, samples[-1]["time"] / 3.0)
    used = [sample for sample in samples if sample["time"] >= warm]
    times, names = np.array([sample["time"] for sample in used]), list(used[0]["looks"])
    report, rows, growths, more = Report("soak", notes=[__doc__ or ""]), [], [], np.zeros(2, int)
    for name in names:
        memory, *counts, cpu = np.array([[one["looks"][name][what] for what in WHATS] for one in used]).T
        growths.append(3600.0 * slope(times, memory / 1024.0))
        ends = [(int(count[0]), int(count[-1])) for count in counts]
        more = np.maximum(more, [last - first for first, last in ends])
        told = f"{memory[0] / 1024.0:.1f} – {memory[-1] / 1024.0:.1f}", f"{growths[-1]:.2f}"
        share = 100.0 * (cpu[-1] - cpu[0]) / (times[-1] - times[0])
        rows.append((name, *told, *(f"{first} – {last}" for first, last in ends), f"{share:.1f}"))
    minutes = times[-1] / 60.0
    of = Headline("times and memory", f"{len(names)} processes, {minutes:.0f} minutes") if minutes > 5.0 else None
    grown = used[-1]["shared_bytes"] - used[0]["shared_bytes"]
    report.bounds += [
        Bound("growth of memory, largest of all processes", 1.0, max(growths), "MB/h", headline=of),
        Bound("descriptors, more at the end, of any process", 0, int(more[0]), ""),
        Bound("threads, more at the end, of any process", 0, int(more[1]), ""),
        Bound("bytes in /dev/shm, more at the end", 0, grown, ""),
    ]
    columns = ("process", "memory, MB", "growth, MB/h", "descriptors", "threads", "CPU, %")
    title = f"First and last of {(times[-1] - times[0]) / 60.0:.0f} min, after {warm / 60.0:.0f} min of warming up"
    report.tables.append(Table(title, columns, rows))
    report.notes.append(f"Driven {samples[-1]['way']:.0f} m; last reason to stop: {samples[-1]['reason'] or 'none'}.")
    return report
