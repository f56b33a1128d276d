"""`sphere_nav plot`: what a localiser said in a recording, as one picture."""

from __future__ import annotations

import argparse
from pathlib import Path

from sphere_nav.geometry.trajectory_error import ALIGNMENTS
from sphere_nav.ros.bags import BagError, BagReader
from sphere_nav_tools.offline.evaluation import (
    AUTO,
    ESTIMATE_TOPICS,
    TRUTH_TOPICS,
    describe_alignment,
    evaluate_poses,
    find_topic,
    read_poses,
    read_trajectory,
)
from sphere_nav_tools.offline.localizing import describe_states
from sphere_nav_tools.offline.settings import PICTURES, add, add_output, choose

HELP = """\
Draw what a localiser said: top view, errors against a truth, states with their reasons, and the time for an image.

BAG is what `sphere_nav localize --bag` or `sphere_nav mcl --bag` wrote, or a recording of the topics pose and status
of a vehicle. The truth is a TUM file, another bag, or ground_truth/... in BAG itself. The ending of FILE chooses the
format: png, pdf or svg.

A map has a frame of its own. Where the truth has another one, --align poses finds the place of the map by all poses, as
sphere_nav evaluate does, and draws the poses there. It is chosen, and said, where it makes sense.

examples:
  sphere_nav plot result -o result.png
  sphere_nav plot result -o result.pdf --truth truth.tum
  sphere_nav plot result -o result.png --truth drive_bag --align none
  sphere_nav plot vehicle.mcap -o vehicle.png --pose /car/pose --status /car/status
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "bag", "BAG", "recording with pose and status", Path)
    add_output(parser, "FILE", "picture to write", PICTURES)
    add(parser, "--pose", "TOPIC", "poses (found by name)")
    add(parser, "--status", "TOPIC", "status of the localiser (found by type)")
    add(parser, "--truth", "F", "true poses: TUM file, or a bag (those in BAG)", Path)
    choose(
        parser,
        "--align",
        (AUTO, *ALIGNMENTS),
        "move the poses to the truth (default: where that has a frame of its own)",
        AUTO,
    )


def run(arguments: argparse.Namespace) -> None:
    """Read, measure, draw; 1 if there is neither a pose nor a status."""
    from sphere_nav_tools.offline import plot_figure  # matplotlib takes half a second to import

    with BagReader(arguments.bag) as bag:
        pose = arguments.pose or find_topic(bag, ESTIMATE_TOPICS)
        statuses = plot_figure.read_statuses(bag, arguments.status)
        has_truth = arguments.truth is not None or find_topic(bag, TRUTH_TOPICS)
    poses = read_poses(arguments.bag, (pose,)) if pose else None
    if poses is None and not statuses:
        raise BagError(f"{arguments.bag}: expected a topic with poses or a status, found neither: --pose, --status")
    judged = None
    if poses is not None and has_truth:
        truth = read_trajectory(arguments.truth or arguments.bag, None, TRUTH_TOPICS)
        judged = evaluate_poses(poses, truth, alignment=arguments.align, is_interpolated=True)
    plot_figure.draw_localization(arguments.output, poses, judged, statuses)
    told = describe_states(statuses)
    told += [] if judged is None else filter(None, [describe_alignment(judged)])
    print("\n".join([*told, f"{arguments.output}: {0 if poses is None else len(poses)} poses"]))
