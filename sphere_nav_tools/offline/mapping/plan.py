"""What a bag is mapped from, by what, and in which segments: the same for the same bag and options, always."""

from __future__ import annotations

import argparse
import hashlib
from dataclasses import dataclass, field, replace
from typing import Any

from sphere_mapping.params import SphereMapperParams
from sphere_mapping.ros.intake import TOPICS
from sphere_nav.geometry.files.rig_file import read_rig
from sphere_nav.params import build
from sphere_nav.ros.bags import BagError, BagReader
from sphere_nav.ros.bags.samples import CAMERA_INFO
from sphere_nav.ros.maps.writer import MapDetails
from sphere_nav.ros.shared_files import software
from sphere_nav_tools.offline import topics
from sphere_nav_tools.offline.constants import OFFLINE_DEADLINE_S
from sphere_nav_tools.offline.mapping.depth_drive import judge_depth
from sphere_nav_tools.offline.mapping.drive import MappedDrive
from sphere_nav_tools.offline.mapping.replay_mapper import Recipe
from sphere_nav_tools.offline.mapping.segments import DriveSegment, cut
from sphere_nav_tools.offline.mapping.sphere_source import CAMERAS, find_input
from sphere_nav_tools.offline.mapping.stereo_drive import find_field
from sphere_nav_tools.offline.mapping.stitcher_ahead import Node, learn_rig
from sphere_nav_tools.offline.mapping.workers import NUM_THREADS

NAMED = "--experience"  # among the options of a plan: what the user calls the light of the drive


@dataclass(frozen=True, eq=False)
class MappingPlan:
    """How a drive is mapped; `stereo`: what was found of a pair, in words; `options`: what the result depends on."""

    recipe: Recipe
    segments: list[DriveSegment]
    kind: str
    stereo: str = ""
    options: dict[str, str] = field(default_factory=dict)

    @property
    def params(self) -> SphereMapperParams:
        """Parameters of the mapper."""
        params: SphereMapperParams = build(SphereMapperParams, self.recipe.values)
        return params

    def with_rig(self) -> MappingPlan:
        """Return the plan with what the beginning of the drive tells of its rig, for the segments that follow."""
        if self.recipe.stitcher is None:
            return self
        with BagReader(self.recipe.bag, damages=[]) as bag:
            return replace(self, recipe=replace(self.recipe, rig=learn_rig(bag, self.recipe.stitcher)))

    def judge(self, drive: MappedDrive) -> None:
        """Take down what is to be told of the cameras beside what was mapped."""
        drive.kind, drive.stereo = self.kind, self.stereo
        if self.kind == "rgbd" and drive.mapper.tracks:
            with BagReader(self.recipe.bag, damages=[]) as bag:
                drive.depth = judge_depth(bag, dict(self.recipe.values), self.recipe.remap, drive)


def make_plan(arguments: argparse.Namespace, rig: str) -> MappingPlan:
    """Return how a bag is mapped, `rig` being the text of its rig file; BagError where it has nothing to map."""
    given = {"mapper.loop.automatic": not arguments.no_loops, "mounting": arguments.mounting}
    values = given | arguments.settings
    details = MapDetails(source=arguments.bag.name, rig=rig)
    with BagReader(arguments.bag, damages=[]) as bag:
        chosen, kind = topics.choose_topics(bag, arguments), arguments.input
        imu, stitcher, pair, stereo = topics.find_imu(bag, chosen), None, None, ""
        if kind == "auto":
            kind = find_input(bag, chosen, has_rig=arguments.rig is not None)
        if kind == CAMERAS:
            stitcher, remap, values = stitcher_values(bag, chosen, arguments), imu, values | {"input": "sphere"}
            images = min(topic for name, topic in stitcher[1].items() if name.endswith("image_raw"))
        else:
            found = topics.find_topics(bag, TOPICS[kind], chosen)
            images = found[TOPICS[kind][0]]
            values = {"slack_s": topics.pairing_slack(bag, images)} | values | {"input": kind}
            pair, stereo = find_field(bag, values, found) if kind == "stereo" else (None, "")
            remap = imu | found
        build(SphereMapperParams, values)  # refused before anything is written
        segments = cut(bag, images) if arguments.extend is None else [DriveSegment()]  # a localiser sees it whole
        held = _told_rarely(bag, images)
        size = f"{bag.num_messages} messages from {bag.time_range[0]} ns to {bag.time_range[1]} ns"
    recipe = Recipe(arguments.bag.resolve(), values, remap, details, stitcher, pair, held=held)
    options = {
        "software": software(), "BAG": f"{arguments.bag.name}, {size}", "segments": str(len(segments)),
        NAMED: arguments.experience,
        "--rig": hashlib.sha256(rig.encode()).hexdigest()[:16] if rig else "none",
        "topics": _text(remap | (stitcher[1] if stitcher else {})), "--set": _text(values),
        "--set-stitcher": _text({**stitcher[0], "rig": "", "jobs": ""} if stitcher else {}),
    }  # fmt: skip
    return MappingPlan(recipe, segments, kind, stereo, options)


def stitcher_values(bag: BagReader, chosen: dict[str, str], arguments: argparse.Namespace) -> Node:
    """Return parameters and topics of the stitcher for a bag with cameras; BagError where bag and rig do not fit."""
    if arguments.rig is None:
        raise BagError(f"{bag.path}: expected --rig with the rig file of its cameras, found none")
    remap = topics.find_rig_topics(bag, read_rig(arguments.rig).names, chosen)
    values = {"sync.deadline_s": OFFLINE_DEADLINE_S} | arguments.set_stitcher
    is_alone = arguments.jobs == 1 and not arguments.scheduler
    fixed = {"rig": str(arguments.rig.resolve()), "transport": "raw", "jobs": NUM_THREADS if is_alone else 1}
    return values | fixed, remap


def _told_rarely(bag: BagReader, images: str) -> tuple[str, ...]:
    """Return the topics of calibrations that do not come with every image."""
    infos = (info for info in bag.topics.values() if info.type == CAMERA_INFO)
    return tuple(info.name for info in infos if 2 * info.count < bag.topics[images].count)


def _text(values: dict[str, Any]) -> str:
    return ", ".join(f"{name}={value}" for name, value in sorted(values.items()))
