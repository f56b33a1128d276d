"""Cameras over DDS at their rate into the real processes: every image is answered, and how old answers are.

One camera of 45 Hz at 800 x 600 into the localiser; a rig of six cameras twice a second into stitcher and mapper.
Images are drawn before and published by a process of their own. An age is the time from an image's stamp, which it has
when it is sent, to the arrival of the answer.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, Image
from sphere_nav_msgs.msg import LocalizationStatus

from benchmarks.report import Bound, Headline, Report, Table
from benchmarks.rig import images_along, rig_in_world
from benchmarks.room import graph_of, look, make_room
from sphere_nav.geometry import SE3, Camera, Pinhole, Spherical
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav.ros import qos
from sphere_nav.ros.conversions import array_to_image, camera_to_info, stamp_ns
from sphere_nav.ros.conversions.headers import SECOND, ns_to_time
from sphere_nav.ros.maps.reader import save_map
from sphere_nav.ros.run import use_large_segment
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.cli.processes import Processes

RATE, SECONDS, QUICK_SECONDS = 45.0, 60.0, 2.0  # of one camera
RIG_RATE, RIG_SECONDS, QUICK_RIG_SECONDS, SPACING_M = 2.0, 300.0, 3.0, 0.7
CAMERA, SPHERE = Pinhole(800, 600, 600.0, 600.0, 399.5, 299.5), Spherical(1024, 512)
LAP, REACH_M, TURN = 90, 0.45, 0.3  # images until the camera is where it was, to and fro, turning; m; rad
SETTLE, SETTLE_S = 50, 0.2  # images of the localiser's start, which is no tracking and is not counted; s between them
RIG_SETTLE, RIG_SETTLE_S = 4, 2.0  # of the rig, which loads kernels with its first images
PATIENCE_S, DRAIN_S, PAUSE_S = 240.0, 10.0, 1.0  # for nodes to be up; for what waits to be worked off; of the player
MAX_AGE_MS, MIN_TRACKED = 50.0, 0.97


@dataclass(frozen=True)
class Case:
    """Nodes with their parameters, what is played to them, and the topic on which they answer."""

    name: str
    nodes: dict[str, dict[str, str]]
    info: tuple[str, Camera]  # topic, lens
    outputs: dict[str, str]  # encoding by the topic; images are in the folder as 0.npy, 1.npy, ...
    periods: list[float]
    answer: str = "status"
    num_uncounted: int = 0  # images of the start


def run(options: argparse.Namespace) -> Report:
    """Play both cases."""
    report, rows = Report("live_rigs", notes=[__doc__ or ""]), list[tuple[str, ...]]()
    for make in (localizer_case, rig_case):
        folder = options.folder / make.__name__
        folder.mkdir()
        case = make(folder, options.seed, options.size == "quick")
        num_sent, answers = listen(case, folder)
        ages = [1e3 * age_s for age_s, _ in answers] or [np.inf]
        rows.append((case.name, str(num_sent), str(len(answers)), f"{np.median(ages):.1f}", f"{max(ages):.1f}"))
        what, of = f"{case.name}, over DDS", Headline("times and memory", f"{num_sent} instants")
        report.bounds.append(Bound(f"{what}: without an answer", 0, num_sent - len(answers), "", headline=of))
        if case.answer == "status":
            tracked = np.mean([state == "TRACKING" for _, state in answers] or [False])
            report.bounds += [
                Bound(f"{what}: oldest answer", MAX_AGE_MS, max(ages), "ms", headline=of),
                Bound(f"{what}: answers in TRACKING", MIN_TRACKED, float(tracked), "", True),
            ]
    columns = ("what", "sent", "answered", "age, median ms", "largest ms")
    report.tables.append(Table("Live, over DDS", columns, rows))
    return report


# --- what is played
def localizer_case(folder: Path, seed: int, is_quick: bool) -> Case:
    """Write a map of the room and a lap of images."""
    places = [SE3.from_planar(x, 0.1, 0.0) for x in np.arange(-2.0, 2.1, 1.0)]
    room = make_room(seed)
    save_map(folder / "map", graph_of(room, SPHERE, places))
    phases = 2 * np.pi * np.arange(LAP) / LAP  # begins at rest, where it has stood: no vehicle drives off in an image
    poses = [SE3.from_planar(REACH_M * np.cos(p), 0.1 * np.cos(2 * p), TURN * np.cos(p)) for p in phases]
    np.save(folder / "0.npy", np.stack([look(room, CAMERA, pose @ T_BODY_OPTICAL)[0] for pose in poses]))
    nodes = {"dense_localizer": {"map": f"{folder / 'map'}", "base_frame": "camera"}}
    periods = [SETTLE_S] * SETTLE + [1.0 / RATE] * round(RATE * (QUICK_SECONDS if is_quick else SECONDS))
    info = ("camera_info", CAMERA)
    return Case("45 Hz into the localiser", nodes, info, {"image_raw": "mono8"}, periods, num_uncounted=SETTLE)


def rig_case(folder: Path, seed: int, is_quick: bool) -> Case:
    """Write the rig file, and the images of a drive along the tour of a city."""
    simulator, rig = rig_in_world(seed, SPHERE.width, {"world": "city"})
    write_rig(folder / "rig.yaml", rig)
    number = round(RIG_RATE * (QUICK_RIG_SECONDS if is_quick else RIG_SECONDS))
    files = []
    for index, part in enumerate(rig.cameras):
        shape = (number, part.camera.height, part.camera.width, 3)
        files.append(np.lib.format.open_memmap(folder / f"{index}.npy", "w+", np.uint8, shape))
    for index, images in enumerate(images_along(simulator, number, SPACING_M)):
        for file, image in zip(files, images.values(), strict=True):
            file[index] = image
    nodes = {
        "sphere_stitcher": {"rig": f"{folder / 'rig.yaml'}"},
        "sphere_mapper": {"map_folder": f"{folder / 'maps'}", "mounting": "0,0,1.6,0,0,0"},
    }
    outputs = {f"cameras/{name}/image_raw": "rgb8" for name in rig.names}
    info = (f"cameras/{rig.names[0]}/camera_info", rig.cameras[0].camera)
    periods = [RIG_SETTLE_S] * RIG_SETTLE + [1.0 / RIG_RATE] * number
    return Case(f"vertical rig at {RIG_RATE:g} Hz", nodes, info, outputs, periods, "odometry", num_uncounted=RIG_SETTLE)


# --- over DDS
def listen(case: Case, folder: Path) -> tuple[int, list[tuple[float, str]]]:
    """Run nodes and player; return how many instants were sent that count, age in s and state of what was answered."""
    answers: dict[int, tuple[float, str]] = {}

    def on_answer(message: Any) -> None:
        stamp = stamp_ns(message)
        answers.setdefault(stamp, ((time.time_ns() - stamp) / 1e9, getattr(message, "state", "")))

    rclpy.init()
    node = rclpy.create_node("live_rigs")
    kind = LocalizationStatus if case.answer == "status" else Odometry
    node.create_subscription(kind, case.answer, on_answer, 1000)

    def spin(seconds: float, is_done: Callable[[], bool]) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end and not is_done():
            rclpy.spin_once(node, timeout_sec=0.05)

    try:
        with Processes(folder) as nodes, ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as player:
            for name, values in case.nodes.items():
                nodes.start(name, values)
            sent = player.submit(play, folder, case)
            spin(2 * PATIENCE_S + sum(case.periods), sent.done)
            stamps = sent.result(DRAIN_S)
            spin(DRAIN_S, lambda: set(stamps) <= set(answers))
        return len(stamps), [answers[stamp] for stamp in stamps if stamp in answers]
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def play(folder: Path, case: Case) -> list[int]:
    """Publish the images of a folder once all are listened to; return the stamps of those that count."""
    use_large_segment()
    topic, camera = case.info
    info, sent = camera_to_info(camera, 0, "camera"), list[int]()
    images = [np.load(folder / f"{number}.npy", mmap_mode="r") for number in range(len(case.outputs))]
    rclpy.init()
    node = rclpy.create_node("player")
    outputs = [node.create_publisher(Image, topic, qos.LARGE) for topic in case.outputs]
    info_output, end = node.create_publisher(CameraInfo, topic, qos.STATE), time.monotonic() + PATIENCE_S
    while time.monotonic() < end and not all(one.get_subscription_count() for one in (*outputs, info_output)):
        time.sleep(0.1)
    time.sleep(PAUSE_S)
    due = time.monotonic()
    before_ns = time.time_ns() - round(due * SECOND)  # of the one clock to the other
    for number, period in enumerate(case.periods):
        at = max(0, number - case.num_uncounted) % len(images[0])
        encodings = zip(images, case.outputs.values(), strict=True)
        messages = [array_to_image(np.array(some[at]), 0, "camera", encoding) for some, encoding in encodings]
        time.sleep(max(0.0, due - time.monotonic()))
        stamp = before_ns + round(due * SECOND)
        for output, message in zip((info_output, *outputs), (info, *messages), strict=True):
            message.header.stamp = ns_to_time(stamp)
            output.publish(message)
        if number >= case.num_uncounted:
            sent.append(stamp)
        due += period
    time.sleep(PAUSE_S)
    rclpy.try_shutdown()
    return sent
