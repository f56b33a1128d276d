"""A rig of six cameras twice a second over DDS, as on a vehicle: stitcher and mapper, two processes on this machine.

The images of a drive along the tour of the simulator's city, 0.7 m from instant to instant, are drawn first and then
published by a third process. What each node received, lost and placed, its diagnostics say; of six images, instants
that lack one are counted by the stitcher. A sphere's age is that of its instant when the mapper has published its pose.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.intake_rate import CHECKOUT, PATIENCE, spin
from benchmarks.machine import describe
from benchmarks.player import SECOND, play_images
from benchmarks.report import Bound, Report, Table
from cycab_sim.params import SimParams
from cycab_sim.simulator import Simulator
from sphere_nav.geometry.files.rig_file import read_rig, write_rig
from sphere_nav.params import build

HELP = "both rigs over DDS at 2 spheres a second for 5 minutes: what is dropped, how old poses are"
RATE, MINUTES, QUICK_MINUTES, SPACING = 2.0, 5.0, 0.25, 0.7  # spheres a second; m
DRAIN = 15.0  # s after the last image, in which all that waits is worked off
DOMAIN = "46"
COMPLETE = "complete"  # a file that says that all images are there
NODES = {"sphere_stitcher": "sphere_mapping.acquisition.ros.node", "sphere_mapper": "sphere_mapping.ros.node"}
READY = ("sphere_stitcher: stitching", "sphere_mapper: mapping")  # what they report when they listen
PLAYER = "import sys; sys.path.append(sys.argv[2]); from benchmarks.live_rigs import play; play(sys.argv[1])"
Values = dict[str, dict[str, str]]


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--live-minutes", type=float, default=MINUTES, help="length of each run (%(default)s)")
    parser.add_argument("--live-rigs", nargs="+", default=["ring", "vertical"], help="rigs (%(default)s)")
    parser.add_argument("--live-seed", type=int, default=401, help="seed of the city (%(default)s)")
    parser.add_argument("--live-images", type=Path, help="folder that keeps the drawn images for another run (none)")


def run(options: argparse.Namespace) -> Report:
    """Drive with each rig."""
    report, rows = Report("live_rigs", notes=[describe(options.threads), __doc__ or ""]), []
    minutes = QUICK_MINUTES if options.quick else options.live_minutes
    for kind in options.live_rigs:
        number = round(60.0 * RATE * minutes)
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch)
            if options.live_images is not None:
                folder = options.live_images / f"{kind}_{options.live_seed}_{number}"
            if not (folder / COMPLETE).exists():
                draw(kind, options.live_seed, number, folder)
            sent, values, ages = drive(folder, Path(scratch) / "maps")
        counts = [lost_by(values, name) for name in NODES]
        middle, oldest = (np.median(ages), max(ages)) if ages else (np.inf, np.inf)
        rows.append((kind, *map(str, (sent, *counts, len(ages))), f"{middle:.2f}", f"{oldest:.2f}"))
        what = f"{kind}, {RATE:g} a second for {minutes:g} min: of {sent} instants"
        report.bounds += [
            Bound(f"{what}: without a pose", 0, sent - len(ages), ""),
            Bound(f"{what}: images or spheres dropped", 0, sum(counts), ""),
        ]
    columns = ("rig", "instants", "images lost", "spheres lost", "placed", "age, median [s]", "largest [s]")
    report.tables.append(Table("Stitcher and mapper, live", columns, rows))
    return report


def draw(kind: str, seed: int, number: int, folder: Path) -> None:
    """Write the rig file, and the images of so many instants along the tour, into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    values = {"world": "city", "seed": seed, "noise_seed": seed, "sphere.width": 0, "rig.kind": kind}
    simulator = Simulator(build(SimParams, values))
    assert simulator.rig is not None
    write_rig(folder / "rig.yaml", simulator.rig)
    file = None
    for index in range(number):
        simulator.teleport(*simulator.path.at(5.0 + SPACING * index).tolist()[:3])
        images = np.stack([frame.image for frame in simulator.capture_rig().values()])
        if file is None:
            shape = (number, *images.shape)
            file = np.lib.format.open_memmap(folder / "images.npy", mode="w+", dtype=np.uint8, shape=shape)
        file[index] = images
    (folder / COMPLETE).touch()


def drive(folder: Path, maps: Path) -> tuple[int, Values, list[float]]:
    """Return how many instants were sent, the last diagnostics of both nodes, and the ages of the poses in s."""
    os.environ |= {"ROS_DOMAIN_ID": DOMAIN, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray
    from nav_msgs.msg import Odometry

    from sphere_nav.ros.conversions import stamp_ns

    values: Values = {}
    ages: list[float] = []

    def on_diagnostics(message: DiagnosticArray) -> None:
        for status in message.status:
            values[status.name] = {pair.key: pair.value for pair in status.values}

    def on_pose(message: Odometry) -> None:
        ages.append((time.time_ns() - stamp_ns(message)) / SECOND)

    rclpy.init()
    node = rclpy.create_node("live_rigs")
    node.create_subscription(DiagnosticArray, "/diagnostics", on_diagnostics, 10)
    node.create_subscription(Odometry, "odometry", on_pose, 10)
    try:
        with nodes(folder, maps):
            spin(node, PATIENCE, lambda: all(ready in values for ready in READY))
            command = [sys.executable, "-P", "-c", PLAYER, str(folder), CHECKOUT]
            with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as player:
                spin(node, 3600.0, lambda: player.poll() is not None)
                assert player.stdout is not None
                sent = json.loads(player.stdout.read())["sent"]
            spin(node, DRAIN, lambda: False)
        return sent, values, ages
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


@contextmanager
def nodes(folder: Path, maps: Path) -> Iterator[None]:
    """Run both nodes with their defaults; the mapper writes to the folder of maps."""
    own = {
        "sphere_stitcher": [f"rig:={folder / 'rig.yaml'}"],
        "sphere_mapper": [f"map_folder:={maps}", "mounting:=0,0,1.6,0,0,0"],
    }
    running = []
    for name, settings in own.items():
        words = ["--ros-args", *(word for one in settings for word in ("-p", one)), "--log-level", "error"]
        code = f"import sys; from {NODES[name]} import main; sys.exit(main())"
        running.append(subprocess.Popen([sys.executable, "-P", "-c", code, *words]))
    try:
        yield
    finally:
        for process in running:
            process.terminate()
        for process in running:
            process.wait(20.0)


def lost_by(values: Values, node: str) -> int:
    """Return how many messages a node says that it has lost, over all its inputs."""
    return sum(int(found.get("lost", 0)) for name, found in values.items() if name.startswith(f"{node}: input "))


def play(folder: str) -> None:
    """Publish the images of a folder at the rate; print how many instants."""
    import rclpy
    from sensor_msgs.msg import CameraInfo, Image

    from sphere_nav.ros import qos
    from sphere_nav.ros.conversions import array_to_image, camera_to_info
    from sphere_nav.ros.run import use_large_segment

    use_large_segment()
    rig, images = read_rig(Path(folder) / "rig.yaml"), np.load(Path(folder) / "images.npy", mmap_mode="r")
    rclpy.init()
    node = rclpy.create_node("player")
    outputs = [node.create_publisher(Image, f"cameras/{name}/image_raw", qos.LARGE) for name in rig.names]
    first = rig.names[0]
    info = node.create_publisher(CameraInfo, f"cameras/{first}/camera_info", qos.SENSOR)
    camera = rig.camera(first).camera

    def messages(number: int) -> list[Any]:
        return [array_to_image(np.array(image), 0, "camera", "rgb8") for image in images[number]]

    periods = [1.0 / RATE] * len(images)
    stamps, late = play_images(
        periods, (info, lambda stamp: camera_to_info(camera, stamp, "camera")), outputs, messages
    )
    sys.stdout.write(json.dumps({"sent": len(stamps), "late_s": late}))
    rclpy.try_shutdown()
