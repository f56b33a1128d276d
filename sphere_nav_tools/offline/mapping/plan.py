"""What a bag is mapped from, and by what: the same for the same bag and options, always."""

from __future__ import annotations

import argparse

from sphere_mapping.params import SphereMapperParams
from sphere_mapping.ros.intake import TOPICS
from sphere_nav.geometry.files.rig_file import read_rig
from sphere_nav.params import build
from sphere_nav.ros.bags import BagError, BagReader
from sphere_nav.ros.maps.writer import MapDetails
from sphere_nav_tools.offline.constants import OFFLINE_DEADLINE_S
from sphere_nav_tools.offline.mapping.replay_mapper import Recipe
from sphere_nav_tools.offline.mapping.stereo_drive import find_field
from sphere_nav_tools.offline.mapping.stitcher_ahead import Node
from sphere_nav_tools.offline.mapping.workers import NUM_THREADS
from sphere_nav_tools.offline.topic_finder import CAMERAS, TopicFinder


def make_recipe(arguments: argparse.Namespace, rig: str) -> Recipe:
    """Return how a bag is mapped, `rig` being the text of its rig file; BagError where it has nothing to map."""
    given = {"mapper.loop.automatic": not arguments.no_loops, "mounting": arguments.mounting}
    values = given | arguments.settings
    build(SphereMapperParams, values)  # refused before anything is read
    details = MapDetails(source=arguments.bag.name, rig=rig)
    with BagReader(arguments.bag) as bag:
        finder = TopicFinder.of(bag, arguments)
        kind, choice = finder.find_source(values, has_rig=arguments.rig is not None)
        imu, stitcher, pair, stereo = finder.imu, None, None, ""
        if kind == CAMERAS:
            stitcher, remap, values = stitcher_values(finder, arguments), imu, values | {"input": "sphere"}
        else:
            found = finder.odometry | choice.topics
            values = {"slack_s": finder.slack_s(found[TOPICS[kind][0]])} | values | {"input": kind}
            pair, stereo = find_field(bag, values, found) if kind == "stereo" else (None, "")
            remap = imu | found
        finder.refuse_unread((*remap, *(stitcher[1] if stitcher is not None else ()), "tf", "tf_static"))
    return Recipe(arguments.bag.resolve(), values, remap, details, kind, stitcher, pair, stereo)


def stitcher_values(finder: TopicFinder, arguments: argparse.Namespace) -> Node:
    """Return parameters and topics of the stitcher for a bag with cameras; BagError where bag and rig do not fit."""
    if arguments.rig is None:
        raise BagError(f"{finder.bag.path}: expected --rig with the rig file of its cameras, found none")
    values = {"sync.deadline_s": OFFLINE_DEADLINE_S} | arguments.set_stitcher
    is_alone = arguments.jobs == 1 and not arguments.scheduler
    fixed = {"rig": str(arguments.rig.resolve()), "transport": "raw", "jobs": NUM_THREADS if is_alone else 1}
    return values | fixed, finder.find_rig(read_rig(arguments.rig).names).topics
