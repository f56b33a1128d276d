"""`sphere_nav evaluate`: estimated poses against true ones."""

from __future__ import annotations

import argparse
from pathlib import Path

from sphere_nav.geometry.trajectory_error import ALIGNMENTS
from sphere_nav_tools.offline.evaluation import (
    AUTO,
    ESTIMATE_TOPICS,
    TRUTH_TOPICS,
    evaluate_poses,
    is_bag,
    read_trajectory,
    report_lines,
)
from sphere_nav_tools.offline.settings import PICTURES, FileAction, add, add_overwrite, choose, flag, read_positive
from sphere_nav_tools.offline.tables import write_json

HELP = """\
Errors of estimated poses against true ones.

examples:
  sphere_nav evaluate poses.tum truth.tum
  sphere_nav evaluate poses.tum drive_bag --json errors.json --plot errors.png
  sphere_nav evaluate poses.tum drive_bag --truth-topic /ground_truth/odometry --align poses --tolerance 0.02
  sphere_nav evaluate poses.tum drive_bag --align-by taught.tum teaching_bag

A map has a frame of its own, and first of all its place in the frame of the truth must be found. --align poses finds it
from all positions and rotations together, also for a straight path; wrong poses count little. It is chosen where the
poses differ by half a metre or 5 deg, and at least five times less once they are aligned. --align-by finds it on
the drive that made the map (sphere_nav map --taught), so that nothing is fitted to the poses that are judged. se3 and
sim3 fit positions alone, as evo does; the rotation about a straight path is then meaningless.

Poses are paired by the nearest stamp within the tolerance (or the truth is interpolated). Lateral is left of the
true direction of motion, longitudinal ahead along it, both in the horizontal plane. Statistics are of absolute values.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "poses", "POSES", "estimated poses: TUM file, or a bag", Path)
    add(parser, "truth", "TRUTH", "true poses: TUM file, or a bag", Path)
    choose(
        parser,
        "--align",
        (AUTO, *ALIGNMENTS),
        "move the estimate first (default: poses where map and truth have frames of their own, else none)",
        AUTO,
    )
    add(parser, "--align-by", ("POSES", "TRUTH"), "find the alignment on these", Path, nargs=2)
    add(parser, "--json", "F", "write all numbers to this file", Path, action=FileAction)
    told = "draw top view and errors over time (png, pdf or svg)"
    add(parser, "--plot", "F", told, Path, action=FileAction, const=PICTURES)
    add_overwrite(parser)
    add(parser, "--tolerance", "S", "largest distance of paired stamps in s (0.01)", read_positive, default=0.01)
    flag(parser, "--interpolate", "interpolate the truth at every estimate's stamp")
    add(parser, "--rpe", "M", "stretch of the relative error in m (1)", read_positive, default=1.0)
    add(parser, "--truth-topic", "TOPIC", f"topic of the truth in a bag (default: {' or '.join(TRUTH_TOPICS)})")
    add(parser, "--poses-topic", "TOPIC", f"topic of the poses in a bag (default: {' or '.join(ESTIMATE_TOPICS)})")


def run(arguments: argparse.Namespace) -> None:
    """Pair, align, measure; print a table; write JSON and plot where asked."""
    estimate = read_trajectory(arguments.poses, arguments.poses_topic, ESTIMATE_TOPICS)
    truth = read_trajectory(arguments.truth, arguments.truth_topic, TRUTH_TOPICS)
    aligned_by = None
    if arguments.align_by:
        if arguments.align == "none":
            raise ValueError("--align-by: expected no --align, or poses, se3 or sim3, found none")
        poses, true_poses = arguments.align_by
        aligned_by = (
            read_trajectory(poses, arguments.poses_topic if is_bag(poses) else None, ESTIMATE_TOPICS),
            read_trajectory(true_poses, arguments.truth_topic if is_bag(true_poses) else None, TRUTH_TOPICS),
        )
    judged = evaluate_poses(
        estimate,
        truth,
        alignment=arguments.align,
        tolerance_s=arguments.tolerance,
        is_interpolated=arguments.interpolate,
        rpe_length_m=arguments.rpe,
        aligned_by=aligned_by,
    )
    print("\n".join(report_lines(judged)))
    if arguments.json:
        write_json(arguments.json, judged.report)
    if arguments.plot:
        from sphere_nav_tools.offline import plot_figure  # matplotlib takes half a second to import

        plot_figure.draw_localization(arguments.plot, estimate, judged, [])
