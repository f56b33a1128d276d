"""A bag played to the node `sphere_mapper`, behind the stitcher where the bag holds the cameras of a rig."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from tqdm import tqdm

from sphere_mapping.acquisition.stereo.stereo_pair import StereoPair
from sphere_mapping.graph.store import SphereStore
from sphere_mapping.mapper import Mapper
from sphere_mapping.params import MapperParams
from sphere_mapping.ros.intake import TOPICS
from sphere_mapping.ros.node import SphereMapper
from sphere_nav.geometry.files.rig_file import read_rig
from sphere_nav.offline import topics
from sphere_nav.offline.constants import OFFLINE_DEADLINE_S
from sphere_nav.offline.mapping.depth_drive import judge_depth
from sphere_nav.offline.mapping.drive import MappedDrive
from sphere_nav.offline.mapping.sphere_source import CAMERAS, find_input
from sphere_nav.offline.mapping.stereo_drive import find_field
from sphere_nav.offline.mapping.stitcher_ahead import StitcherAhead, stitch_apart
from sphere_nav.offline.mapping.workers import NUM_THREADS, Workers
from sphere_nav.ros.bags import BagError, BagReader
from sphere_nav.ros.bags.replay import OfflineBus, replay, required_topics

IMU_NS = 1_000_000_000  # of the bag's beginning: its first image may come before the IMU
Node = tuple[dict[str, Any], dict[str, str]]  # values of parameters by dotted name, topics of the bag by ours


def map_bag(
    arguments: argparse.Namespace,
    store: SphereStore,
    first: int,
    workers: Workers,
    make: Callable[..., Mapper] = Mapper,
) -> MappedDrive:
    """Return the bag mapped from what it holds, ids from `first` on; BagError where no sphere comes of it."""
    given = {"mapper.loop.automatic": not arguments.no_loops, "mounting": arguments.mounting}
    values = given | arguments.settings

    def begin(params: MapperParams) -> Mapper:
        mapper = make(params, store=store)
        mapper.first_id = first
        return mapper

    with BagReader(arguments.bag) as bag:
        chosen, kind = topics.choose_topics(bag, arguments), arguments.input
        imu = topics.find_imu(bag, chosen)
        if kind == "auto":
            kind = find_input(bag, chosen, has_rig=arguments.rig is not None)
        if kind == CAMERAS:
            stitcher = stitcher_values(bag, chosen, arguments)
            drive = replay_mapper(bag, begin, values | {"input": "sphere"}, imu, stitcher, workers=workers)
        else:
            found = topics.find_topics(bag, TOPICS[kind], chosen)
            slack_s = topics.pairing_slack(bag, found[TOPICS[kind][0]])
            values = {"slack_s": slack_s} | values | {"input": kind}
            pair, stereo = find_field(bag, values, found) if kind == "stereo" else (None, "")
            drive = replay_mapper(bag, begin, values, imu | found, pair=pair)
            drive.stereo = stereo
            drive.depth = judge_depth(bag, values, found, drive) if kind == "rgbd" else ""
    drive.kind = kind
    if not drive.node.mapper.tracks:
        reason = drive.refusal or "no complete instant"
        raise BagError(f"{arguments.bag}: expected spheres to map, found none: {reason}")
    return drive


def replay_mapper(
    bag: BagReader,
    begin: Callable[[MapperParams], Mapper],
    values: dict[str, Any],
    remap: dict[str, str],
    stitcher: Node | None = None,
    pair: StereoPair | None = None,
    workers: Workers | None = None,
) -> MappedDrive:
    """Play a bag to a mapper, behind a stitcher where that is given, or with a stereo pair's correction."""
    bus = OfflineBus(captured=set())
    stitching = None if stitcher is None else bus.add(StitcherAhead, *stitcher)
    if stitcher is not None and workers is not None and workers.executor is not None:
        assert isinstance(stitching, StitcherAhead)
        stitching.coming_from = stitch_apart(bag.path, *stitcher, workers.executor, workers.num_ahead)
    node = bus.add(SphereMapper, values, remap)
    assert isinstance(node, SphereMapper)
    node.mapper = begin(node.params.mapper)
    hear_beginning(bag, node, remap.get("imu", ""))
    if pair is not None:
        node.intake.stereo.use(pair)
    total = sum(bag.topics[topic].count for topic in required_topics(bag, bus))
    try:
        with tqdm(total=total, desc="map", unit="message", leave=False, disable=None) as bar:
            for _ in replay(bag, bus, progress=bar.update):
                pass
            if isinstance(stitching, StitcherAhead):
                stitching.finish_open()
                stitching.publish_last()
                for _ in bus.settle():
                    pass
    finally:
        if stitching is not None:
            stitching.cleanup()
    inputs = [*node.inputs, *(stitching.inputs if stitching else ())]
    reasons = [f"{w.num_refused} of {w.topic}: {w.last_refusal}" for w in inputs if w.num_refused]
    if isinstance(stitching, StitcherAhead) and stitching.intake is not None:
        for name, health in stitching.intake.sync.health.items():
            if health.problem:
                reasons.append(f"{name}: {health.problem} ({health.num_missing} times)")
    return MappedDrive(node, node.num_lost, "; ".join(reasons))


def hear_beginning(bag: BagReader, node: SphereMapper, imu: str) -> None:
    """Tell a node what fixes the frame of its map, before it sees the first image: mounts, and the IMU about then."""
    if topics.TF_STATIC_TOPIC in bag.topics:
        for _, _, message in bag.messages([topics.TF_STATIC_TOPIC]):
            for transform in message.transforms:
                with suppress(ValueError):  # the replay reports it
                    node.tf.tree.add(transform, is_static=True)
    if imu in bag.topics:
        first, _ = bag.time_range
        for _, _, message in bag.messages([imu], end_ns=first + IMU_NS):
            node.vehicle.on_imu(message)


def stitcher_values(bag: BagReader, chosen: dict[str, str], arguments: argparse.Namespace) -> Node:
    """Return parameters and topics of the stitcher for a bag with cameras; BagError where bag and rig do not fit."""
    if arguments.rig is None:
        raise BagError(f"{bag.path}: expected --rig with the rig file of its cameras, found none")
    remap = topics.find_rig_topics(bag, read_rig(arguments.rig).names, chosen)
    values = {"sync.deadline_s": OFFLINE_DEADLINE_S} | arguments.set_stitcher
    return values | {"rig": str(arguments.rig), "transport": "raw", "jobs": NUM_THREADS}, remap
