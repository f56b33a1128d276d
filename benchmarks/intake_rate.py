"""An RGB-D camera of 45 Hz at 800 x 600 into the mapper, raw and compressed: every message is handled or counted.

Publisher, node and listener are three processes. The mapper computes longer than 22 ms, so that it must lose images;
what it loses, and on which topic, its diagnostics say: sent = received + lost, to the message. The publisher measures
itself: how much later than planned it sent.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import describe
from benchmarks.player import play_images
from benchmarks.report import Bound, Report, Table

HELP = "45 Hz at 800 x 600 into the mapper over DDS, raw and compressed: what is lost is counted"
RATE, SECONDS, QUICK_SECONDS = 45.0, 20.0, 5.0
WIDTH, HEIGHT = 800, 600
TAIL, TAIL_PERIOD = 6, 1.0  # slow messages at the end: a gap is seen by what comes after it
PATIENCE = 90.0  # s for the node to be up, kernels compiled
DOMAIN = "48"
CHECKOUT = str(Path(__file__).resolve().parents[1])
NODE = "import sys; from sphere_mapping.ros.node import main; sys.exit(main())"
PLAYER = "import sys; sys.path.append(sys.argv[3]); from benchmarks.intake_rate import play; play(*sys.argv[1:3])"
TOPICS = {
    "raw": ("image_raw", "depth/image_raw"),
    "compressed": ("image_raw/compressed", "depth/image_raw/compressedDepth"),
}


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Nothing to choose."""


def run(options: argparse.Namespace) -> Report:
    """Play to the mapper in both transports, read its diagnostics."""
    seconds = QUICK_SECONDS if options.quick else SECONDS
    report, rows = Report("intake_rate", notes=[describe(options.threads), __doc__ or ""]), []
    for transport, topics in TOPICS.items():
        played, values = _measure(transport, seconds)
        for topic in topics:
            found = {key: int(value) for key, value in values.get(f"input {topic}", {}).items()}
            received, lost = found.get("received", 0), found.get("lost", 0)
            uncounted = played["sent"] - received - lost
            rows.append((topic, *map(str, (played["sent"], received, lost, found.get("refused", 0), uncounted))))
            report.bounds.append(
                Bound(f"45 Hz into the mapper, {topic}: neither received nor counted", 0, uncounted, "")
            )
        report.notes.append(f"{transport}: the publisher was at most {1e3 * played['late_s']:.1f} ms late")
    columns = ("topic", "sent", "received", "lost", "refused", "not counted")
    report.tables.append(Table(f"{RATE:.0f} Hz for {seconds:.0f} s and {TAIL} slow ones", columns, rows))
    return report


def _measure(transport: str, seconds: float) -> tuple[dict[str, Any], dict[str, dict[str, str]]]:
    """Return what the player says of itself, and the last values of every entry of the mapper's diagnostics."""
    os.environ |= {"ROS_DOMAIN_ID": DOMAIN, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray

    values: dict[str, dict[str, str]] = {}

    def on_diagnostics(message: DiagnosticArray) -> None:
        for status in message.status:
            values[status.name.removeprefix("sphere_mapper: ")] = {pair.key: pair.value for pair in status.values}

    rclpy.init()
    node = rclpy.create_node("intake_rate")
    node.create_subscription(DiagnosticArray, "/diagnostics", on_diagnostics, 10)
    maps = tempfile.TemporaryDirectory()
    settings = ("input:=rgbd", f"transport:={transport}", f"map_folder:={maps.name}")
    words = ["--ros-args", *(word for setting in settings for word in ("-p", setting)), "--log-level", "error"]
    mapper = subprocess.Popen([sys.executable, "-P", "-c", NODE, *words])
    try:
        spin(node, PATIENCE, lambda: bool(node.count_publishers("map_cloud")))
        command = [sys.executable, "-P", "-c", PLAYER, transport, str(seconds), CHECKOUT]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as player:
            spin(node, PATIENCE + seconds, lambda: player.poll() is not None)
            assert player.stdout is not None
            said = json.loads(player.stdout.read())
        spin(node, 3.0, lambda: False)
        return said, values
    finally:
        mapper.terminate()
        mapper.wait(10.0)
        maps.cleanup()
        node.destroy_node()
        rclpy.try_shutdown()


def spin(node: Any, seconds: float, is_done: Callable[[], bool]) -> None:
    """Let a node hear what comes until something is done, or for so long."""
    import rclpy

    end = time.monotonic() + seconds
    while time.monotonic() < end and not is_done():
        rclpy.spin_once(node, timeout_sec=0.1)


def play(transport: str, seconds: str) -> None:
    """Publish one RGB-D image again and again with new stamps, made ready before; print how that went."""
    import cv2
    import rclpy
    from sensor_msgs.msg import CameraInfo, CompressedImage, Image

    from sphere_nav.geometry import Pinhole
    from sphere_nav.ros import qos
    from sphere_nav.ros.conversions import array_to_image, camera_to_info
    from sphere_nav.ros.run import use_large_segment

    use_large_segment()
    noise = cv2.GaussianBlur(np.random.default_rng(1).uniform(0, 255, (HEIGHT, WIDTH)).astype(np.float32), (0, 0), 3.0)
    gray = cv2.normalize(noise, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    depth = np.full((HEIGHT, WIDTH), 3000, np.uint16)
    messages: list[Any] = [array_to_image(gray, 0, "camera", "mono8"), array_to_image(depth, 0, "camera", "16UC1")]
    if transport == "compressed":
        jpeg, png = cv2.imencode(".jpg", gray)[1].tobytes(), bytes(12) + cv2.imencode(".png", depth)[1].tobytes()
        kinds = ((jpeg, "mono8; jpeg compressed mono8"), (png, "16UC1; compressedDepth png"))
        messages = [CompressedImage(format=format_, data=data) for data, format_ in kinds]
        for message in messages:
            message.header.frame_id = "camera"
    rclpy.init()
    node = rclpy.create_node("player")
    info = node.create_publisher(CameraInfo, "camera_info", qos.STATE)
    kind = Image if transport == "raw" else CompressedImage
    outputs = [node.create_publisher(kind, topic, qos.LARGE) for topic in TOPICS[transport]]
    camera = Pinhole(WIDTH, HEIGHT, 600.0, 600.0, WIDTH / 2 - 0.5, HEIGHT / 2 - 0.5)
    periods = [1 / RATE] * round(RATE * float(seconds)) + [TAIL_PERIOD] * TAIL
    info_first = (info, lambda stamp: camera_to_info(camera, stamp, "camera"))
    stamps, late = play_images(periods, info_first, outputs, lambda number: messages)
    sys.stdout.write(json.dumps({"sent": len(stamps), "late_s": late}))
    rclpy.try_shutdown()
