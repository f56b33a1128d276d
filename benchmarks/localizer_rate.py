"""A camera of 45 Hz through the node over DDS: images that were dropped, and how old the answers are.

The node, a player of images and the listener are three processes. Age is the time from the stamp of an image, which
the player gives when it sends it, to the arrival of its status at the listener.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from benchmarks.localizer_times import CAMERA, SPHERE
from benchmarks.machine import describe
from benchmarks.player import play_images
from benchmarks.report import Bound, Report, Table
from benchmarks.room import render
from sphere_nav.geometry import SE3
from sphere_nav.ros.maps.reader import save_map
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere

HELP = "45 Hz at 800 x 600 through the node over DDS for a minute: drops and ages"
RATE = 45.0  # Hz
SECONDS, QUICK_SECONDS = 60.0, 10.0
LAP = 180  # images until the camera is where it was: to and fro, at most 1.4 m/s, turning
REACH, TURN = 0.9, 0.3  # m, rad
SETTLE, SETTLE_RATE = 50, 5.0  # images of the start, which is no tracking and is not counted; Hz
MAX_AGE_MS = 50.0
PATIENCE = 60.0  # s for the node to be up
DOMAIN = "49"
NODE = "import sys; from dense_localizer.ros.node import main; sys.exit(main())"
PLAYER = "import sys; sys.path.append(sys.argv[3]); from benchmarks.localizer_rate import play; play(*sys.argv[1:3])"
CHECKOUT = str(Path(__file__).resolve().parents[1])


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Nothing to choose."""


def run(options: argparse.Namespace) -> Report:
    """Play, listen, compare."""
    seconds = QUICK_SECONDS if options.quick else SECONDS
    with tempfile.TemporaryDirectory() as folder:
        _make(Path(folder))
        sent, ages, states = _listen(Path(folder), seconds)
    rows: list[tuple[str, ...]] = [
        ("images sent", f"{sent}"),
        ("answered", f"{len(ages)}"),
        ("tracked", f"{states.count('TRACKING')}"),
    ]
    rows += [(f"age, {name}, ms", f"{value:.1f}") for name, value in _statistics(ages)]
    report = Report("localizer_rate", notes=[describe(options.threads), __doc__ or ""])
    report.tables.append(Table(f"{RATE:.0f} Hz for {seconds:.0f} s", ("what", "found"), rows))
    report.bounds = [
        Bound("45 Hz over DDS: images without an answer", 0.0, float(sent - len(ages)), ""),
        Bound("45 Hz over DDS: oldest answer", MAX_AGE_MS, float(ages.max(initial=0.0)) if ages.size else np.nan, "ms"),
        Bound("45 Hz over DDS: images tracked", 0.97, states.count("TRACKING") / max(sent, 1), "", is_minimum=True),
    ]
    return report


def _statistics(ages: NDArray[np.float64]) -> list[tuple[str, float]]:
    if not ages.size:
        return []
    return [(name, float(np.percentile(ages, q))) for name, q in (("median", 50), ("p99", 99), ("largest", 100))]


def _make(folder: Path) -> None:
    """Write a map of the room and a lap of images."""
    graph = SphereGraph()
    for number, x in enumerate(np.arange(-2.0, 2.1, 1.0)):
        T = SE3.from_planar(x, 0.1, 0.0)
        graph.add(KeySphere(number, number + 1, T, Sphere(*render(SPHERE, T), SPHERE, number + 1)))
    save_map(folder / "map", graph)
    phases = 2 * np.pi * np.arange(LAP) / LAP
    poses = [SE3.from_planar(REACH * np.sin(p), 0.1 * np.sin(2 * p), TURN * np.cos(p)) @ T_BODY_OPTICAL for p in phases]
    images = [render(CAMERA, pose)[0] for pose in tqdm(poses, "images", leave=False, disable=None)]
    np.save(folder / "images.npy", np.stack(images))


def _listen(folder: Path, seconds: float) -> tuple[int, NDArray[np.float64], list[str]]:
    """Return how many images were sent, and ages in ms and states of the answers."""
    os.environ |= {"ROS_DOMAIN_ID": DOMAIN, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    import rclpy
    from sphere_nav_msgs.msg import LocalizationStatus

    from sphere_nav.ros.conversions import stamp_ns

    words = ["--ros-args", "-p", f"map:={folder / 'map'}", "-p", "base_frame:=camera", "--log-level", "error"]
    rclpy.init()
    found: dict[int, tuple[float, str]] = {}

    def on_status(message: LocalizationStatus) -> None:
        stamp = stamp_ns(message)
        found.setdefault(stamp, ((time.time_ns() - stamp) * 1e-6, message.state))

    node = rclpy.create_node("localizer_rate")
    node.create_subscription(LocalizationStatus, "status", on_status, 1000)
    with subprocess.Popen([sys.executable, "-P", "-c", NODE, *words]) as localizer:
        try:
            end = time.monotonic() + PATIENCE
            while not node.count_publishers("pose") and time.monotonic() < end:
                rclpy.spin_once(node, timeout_sec=0.2)
            player = subprocess.Popen(
                [sys.executable, "-P", "-c", PLAYER, str(folder), str(seconds), CHECKOUT], stdout=-1, text=True
            )
            while player.poll() is None:
                rclpy.spin_once(node, timeout_sec=0.05)
            end = time.monotonic() + 1.0
            while time.monotonic() < end:
                rclpy.spin_once(node, timeout_sec=0.05)
            assert player.stdout is not None
            sent = [int(line) for line in player.stdout]
        finally:
            localizer.terminate()
            node.destroy_node()
            rclpy.try_shutdown()
    answered = [found[stamp] for stamp in sent if stamp in found]
    return len(sent), np.array([age for age, _ in answered]), [state for _, state in answered]


def play(folder: str, seconds: str) -> None:
    """Publish the lap again and again at the rate of the camera; print the stamp of every image."""
    import rclpy
    from sensor_msgs.msg import CameraInfo, Image

    from sphere_nav.ros import qos
    from sphere_nav.ros.conversions import array_to_image, camera_to_info
    from sphere_nav.ros.run import use_large_segment

    use_large_segment()
    images = np.load(Path(folder) / "images.npy")
    rclpy.init()
    node = rclpy.create_node("player")
    info = node.create_publisher(CameraInfo, "camera_info", qos.STATE)
    output = node.create_publisher(Image, "image_raw", qos.LARGE)
    messages = [array_to_image(image, 0, "camera", "mono8") for image in images]
    periods = [1.0 / SETTLE_RATE] * SETTLE + [1.0 / RATE] * round(RATE * float(seconds))
    info_first = (info, lambda stamp: camera_to_info(CAMERA, stamp, "camera"))
    stamps, _ = play_images(
        periods, info_first, [output], lambda number: [messages[max(number - SETTLE, 0) % len(messages)]]
    )
    sys.stdout.write("".join(f"{stamp}\n" for stamp in stamps[SETTLE:]))
    rclpy.try_shutdown()
