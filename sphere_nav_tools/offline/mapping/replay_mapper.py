"""A bag played to `sphere_mapper`, behind the stitcher where it holds the cameras of a rig: what to what, and how."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import suppress

from sphere_mapping.mapper import Mapper
from sphere_mapping.params import MapperParams, SphereMapperParams
from sphere_mapping.ros.intake import TOPICS
from sphere_mapping.ros.node import SphereMapper
from sphere_nav.geometry.files.rig_file import read_rig
from sphere_nav.params import build
from sphere_nav.ros.bags import BagError, BagReader
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.maps.writer import MapDetails
from sphere_nav_tools.offline import topics
from sphere_nav_tools.offline.constants import IMU_NS, PATIENCE_S
from sphere_nav_tools.offline.localizing import replay_shown
from sphere_nav_tools.offline.mapping.drive import MappedDrive, Recipe
from sphere_nav_tools.offline.mapping.stereo_drive import find_field
from sphere_nav_tools.offline.mapping.stitcher_ahead import Node, StitcherAhead
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
    values = {"sync.deadline_s": PATIENCE_S} | arguments.set_stitcher
    is_alone = arguments.jobs == 1 and not arguments.scheduler
    fixed = {"rig": str(arguments.rig.resolve()), "transport": "raw", "jobs": NUM_THREADS if is_alone else 1}
    return values | fixed, finder.find_rig(read_rig(arguments.rig).names).topics


def replay_mapper(
    recipe: Recipe, make: Callable[[MapperParams], Mapper], executor: Executor | None = None
) -> MappedDrive:
    """Play a bag to the mapper that is made; an `executor` stitches."""
    bus, stitching = OfflineBus(captured=set()), None
    if recipe.stitcher is not None:
        stitching = bus.add(StitcherAhead, *recipe.stitcher)
        stitching.executor = executor
    node = bus.add(SphereMapper, recipe.values, recipe.remap)
    node.mapper = make(node.params.mapper)
    try:
        with BagReader(recipe.bag) as bag:
            hear_beginning(bag, node, recipe.remap.get("imu", ""))
            if recipe.pair is not None:
                node.intake.stereo.use(recipe.pair)
            for _ in replay_shown("map", "message", bag, bus):
                pass
        if stitching is not None:
            stitching.finish_open()
            while stitching.coming:
                stitching.publish_next()
            for _ in bus.settle():
                pass
    finally:
        if stitching is not None:
            stitching.cleanup()
    node.mapper.keep_end()
    return MappedDrive(recipe, node.mapper, node.mount, node.num_lost, refusals(node, stitching))


def refusals(node: SphereMapper, stitching: StitcherAhead | None) -> str:
    """Return what was refused or missing, how often and why, in one line."""
    inputs = [*node.inputs, *(stitching.inputs if stitching else ())]
    found = [f"{one.num_refused} of {one.topic}: {one.last_refusal}" for one in inputs if one.num_refused]
    if stitching is not None and stitching.intake is not None:
        cameras = stitching.intake.sync.health.items()
        found += [f"{name}: {one.problem} ({one.num_missing} times)" for name, one in cameras if one.problem]
    return "; ".join(found)


def hear_beginning(bag: BagReader, node: SphereMapper, imu: str) -> None:
    """Tell a node what fixes the frame of its map, before it sees the first image: mounts, and the IMU about then."""
    if topics.TF_STATIC_TOPIC in bag.topics:
        for _, _, message in bag.messages([topics.TF_STATIC_TOPIC]):
            for transform in message.transforms:
                with suppress(ValueError):  # the replay reports it
                    node.tf.add(transform, is_static=True)
    if imu in bag.topics:
        first, _ = bag.time_range
        for _, _, message in bag.messages([imu], end_ns=first + IMU_NS):
            node.vehicle.on_imu(message)
