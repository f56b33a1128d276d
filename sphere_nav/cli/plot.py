"""`sphere_nav plot`: what a localiser said in a recording, as one picture."""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path

import numpy as np

from sphere_nav.geometry.trajectory import Trajectory, read_tum
from sphere_nav.geometry.trajectory_error import AbsoluteErrors
from sphere_nav.localization.status import Reason, Status
from sphere_nav.offline.evaluation import TRUTH_TOPICS, judge
from sphere_nav.offline.pose_bags import READINGS, is_bag, read_poses
from sphere_nav.ros import conversions
from sphere_nav.ros.bags import BagError, BagReader
from sphere_nav.ros.bags.streams import TRUTH_WORDS

HELP = """\
Draw what a localiser said: top view, errors against a truth, states with their reasons, and the time for an image.

BAG is what `sphere_nav localize --bag` or `sphere_nav mcl --bag` wrote, or a recording of the topics pose and status
of a vehicle. The truth is a TUM file, another bag, or ground_truth/... in BAG itself. The ending of FILE chooses the
format: png, pdf or svg.

examples:
  sphere_nav plot result -o result.png
  sphere_nav plot result -o result.pdf --truth truth.tum
  sphere_nav plot vehicle.mcap -o vehicle.png --pose /car/pose --status /car/status
"""
STATUS = "sphere_nav_msgs/msg/LocalizationStatus"
POSE_NAMES = ("pose", "odometry")
ENDINGS = (".png", ".pdf", ".svg")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("bag", type=Path, metavar="BAG", help="recording with pose and status")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help="picture to write")
    parser.add_argument("--pose", metavar="TOPIC", help="poses (found by name)")
    parser.add_argument("--status", metavar="TOPIC", help="status of the localiser (found by type)")
    parser.add_argument("--truth", type=Path, metavar="F", help="true poses: TUM file, or a bag (those in BAG)")
    parser.add_argument("--overwrite", action="store_true", help="replace the file that is there")


def run(arguments: argparse.Namespace) -> int:
    """Read, measure, draw; 1 if there is neither a pose nor a status."""
    output = arguments.output
    if output.suffix not in ENDINGS:
        raise ValueError(f"{output}: expected a file {', '.join(ENDINGS)}, found ending {output.suffix!r}")
    if output.exists() and not arguments.overwrite:
        raise ValueError(f"{output}: expected no such file, found one: --overwrite replaces it")
    with BagReader(arguments.bag) as bag:
        pose = arguments.pose or find_pose(bag)
        statuses = read_statuses(bag, arguments.status or find_status(bag))
    poses = read_poses(arguments.bag, (pose,)) if pose else None
    if poses is None and not statuses:
        raise BagError(f"{arguments.bag}: expected a topic with poses or a status, found neither: --pose, --status")
    errors = measure(poses, arguments.truth or arguments.bag, is_required=arguments.truth is not None)
    from sphere_nav.offline.plot_figure import draw  # matplotlib takes half a second to import

    draw(output, poses, errors, statuses)
    print("\n".join([*describe(statuses), f"{output}: {0 if poses is None else len(poses)} poses"]))
    return 0


def find_pose(bag: BagReader) -> str:
    """Return the topic of poses by its last name, those of a pose before odometry; empty where there is none."""
    topics = [info.name for info in bag.topics.values() if info.count and info.type in READINGS]
    named = [t for name in POSE_NAMES for t in sorted(topics) if t.split("/")[-1] == name]
    return next((topic for topic in named if not any(word in topic for word in TRUTH_WORDS)), "")


def find_status(bag: BagReader) -> str:
    """Return the one topic with the status of a localiser; empty: none. BagError for several."""
    topics = sorted(info.name for info in bag.topics.values() if info.type == STATUS and info.count)
    if len(topics) > 1:
        raise BagError(f"{bag.path}: expected one status, found {', '.join(topics)}: choose by --status")
    return topics[0] if topics else ""


def read_statuses(bag: BagReader, topic: str) -> list[Status]:
    """Return what was said of every image, and of silences; BagError for a topic of another type."""
    if not topic:
        return []
    info = bag.require(topic)
    if info.type != STATUS:
        raise BagError(f"{bag.path}: {info.name}: expected {STATUS}, found {info.type}")
    return [conversions.message_to_status(message) for _, _, message in bag.messages([topic])]


def measure(
    poses: Trajectory | None, truth: Path, *, is_required: bool
) -> tuple[Trajectory, Trajectory, AbsoluteErrors] | None:
    """Return estimate, truth and errors; None where a bag has no truth that is asked for by nobody."""
    if poses is None:
        return None
    if is_bag(truth):
        with BagReader(truth) as bag:
            topics = [t for t in TRUTH_TOPICS if f"/{t}" in bag.topics and bag.topics[f"/{t}"].count]
        if not topics and not is_required:
            return None
        judged = judge(poses, read_poses(truth, tuple(topics) or TRUTH_TOPICS), is_interpolated=True)
    else:
        judged = judge(poses, read_tum(truth), is_interpolated=True)
    return judged.estimate, judged.truth, judged.errors


def describe(statuses: list[Status]) -> list[str]:
    """Return how often each state was told for each reason, with the remedy, and the time for an image."""
    counts = Counter((str(status.state), str(status.reason)) for status in statuses)
    remedies = {(str(status.state), str(status.reason)): status.remedy for status in statuses}
    lines = [
        f"{number:6d}  {state:<14} {reason:<14} {remedies[state, reason]}".rstrip()
        for (state, reason), number in counts.most_common()
    ]
    times = [status.milliseconds for status in statuses if status.reason != Reason.TIMEOUT and status.milliseconds > 0]
    if times:
        lines.append(f"time for an image: median {np.median(times):.1f} ms, p99 {np.percentile(times, 99):.1f} ms")
    return lines
