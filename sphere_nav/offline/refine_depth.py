"""`sphere_nav refine-camera BAG`: where the depth camera of an RGB-D camera sits beside the image's, from a drive."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import yaml

from rig_calibration.drive.depth_pose import RefinedDepth
from sphere_mapping.mapper import Mapper
from sphere_mapping.ros.intake import TOPICS
from sphere_nav.offline import topics
from sphere_nav.offline.mapping.depth_drive import describe_components, refine_depth
from sphere_nav.offline.mapping.replay_mapper import replay_mapper
from sphere_nav.offline.mapping.sphere_source import find_input
from sphere_nav.ros.bags import BagError, BagReader
from sphere_nav.ros.camera.mounting import NAMES


def run_depth(arguments: argparse.Namespace) -> int:
    """Map the drive, refine the depth camera by pairs of it; 1 if the drive does not tell everything."""
    given = {"camera.readout": arguments.readout, "mapper.loop.automatic": False}
    values = given | arguments.settings | {"input": "rgbd"}
    with BagReader(arguments.source) as bag:
        chosen = topics.choose_topics(bag, arguments)
        kind = find_input(bag, chosen)
        if kind != "rgbd":
            raise BagError(f"{arguments.source}: expected images with depth where no MAP is given, found {kind}")
        found = topics.find_topics(bag, TOPICS["rgbd"], chosen)
        values = {"slack_s": topics.pairing_slack(bag, found["image_raw"])} | values
        drive = replay_mapper(bag, Mapper, values, found)
        if not drive.node.mapper.tracks:
            raise BagError(f"{arguments.source}: expected images to align, found none: {drive.refusal}")
        estimate = refine_depth(bag, values, found, drive.node.mapper)
    arguments.output.write_text(depth_file_text(estimate.found), encoding="utf-8")
    print("\n".join([*report_depth(estimate.found, str(arguments.output)), *filter(None, [estimate.verdict])]))
    return 1 if estimate.found.unobserved else 0


def depth_file_text(found: RefinedDepth) -> str:
    """Return the file that `depth_pose` takes: x y z roll pitch yaw (m, rad), their standard deviations beside."""
    values = [*found.T_image_depth.translation, *found.T_image_depth.angles]
    deviations = zip(NAMES, found.deviations.values(), strict=True)
    content = {name: float(value) for name, value in zip(NAMES, values, strict=True)}
    return yaml.safe_dump({"depth_pose": content, "standard_deviations": dict(deviations)}, sort_keys=False)


def report_depth(found: RefinedDepth, output: str) -> Iterator[str]:
    """Yield what is printed."""
    yield f"{len(found.states)} pairs, {found.num_pixels} pixels, residual {found.residual:.1f} grey levels -> {output}"
    yield "depth camera in the axes of the image's (x right, y down, z ahead):"
    yield from describe_components(found)
    if found.unobserved:
        yield "record surfaces at several distances and slopes, and move by half of their distance, not only turn"
    yield f"to map with it: sphere_nav map BAG -o MAP --set depth_pose={output}"
