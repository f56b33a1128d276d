"""A segment of a bag played to `sphere_mapper`, behind the stitcher where the bag holds the cameras of a rig."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from std_msgs.msg import Header
from tqdm import tqdm

from sphere_mapping.acquisition.stereo.stereo_pair import StereoPair
from sphere_mapping.graph.tracking import Unroll
from sphere_mapping.mapper import Mapper
from sphere_mapping.params import MapperParams
from sphere_mapping.ros.mount import CameraMount
from sphere_mapping.ros.node import SphereMapper
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.bags.replay import OfflineBus, replay, required_topics
from sphere_nav.ros.maps.writer import MapDetails
from sphere_nav.spheres.sphere import Sphere
from sphere_nav_tools.offline import topics
from sphere_nav_tools.offline.constants import IMU_NS
from sphere_nav_tools.offline.mapping.drive import MappedDrive
from sphere_nav_tools.offline.mapping.segments import DriveSegment
from sphere_nav_tools.offline.mapping.stitcher_ahead import LearnedRig, Node, StitcherAhead

HEARD = "/sphere_mapper/heard"  # each sphere, so that a replay can end


@dataclass(frozen=True, eq=False)
class Recipe:
    """By what every segment of a drive is mapped: the bag, parameters and topics, and what is known of the cameras."""

    bag: Path
    values: Mapping[str, Any]
    remap: dict[str, str]
    details: MapDetails
    stitcher: Node | None = None
    pair: StereoPair | None = None
    rig: LearnedRig | None = None
    held: tuple[str, ...] = ()  # topics of calibrations that are told now and then


class SegmentMapper(SphereMapper):
    """The mapper of one segment; the frame of all but the first one is that of its first sphere."""

    segment = DriveSegment()

    def configure(self) -> None:
        """Tell each sphere."""
        super().configure()
        self.is_done, self._is_begun = False, False
        self.heard = self.add_publisher(HEARD, Header)

    def on_sphere(self, sphere: Sphere, mount: CameraMount, unroll: Unroll | None = None) -> None:
        """Map a sphere of the segment; the first one that is placed becomes a key sphere."""
        segment = self.segment
        self.is_done = sphere.stamp_ns >= segment.last_ns
        if segment.warm_ns <= sphere.stamp_ns <= segment.last_ns:
            super().on_sphere(sphere, mount, unroll)
            tracks = self.mapper.tracks
            if sphere.stamp_ns <= segment.first_ns:
                self.num_lost = 0  # the segment before counts it
            if not self._is_begun and tracks and tracks[-1].stamp_ns >= segment.first_ns and not segment.is_first:
                self._is_begun = True
                self.mapper.keep_end(is_near=True)
        self.heard.publish(Header())

    def begin_map(self, sphere: Sphere) -> bool:
        """Begin the map with the first segment, any other one where its first sphere is."""
        return super().begin_map(sphere) if self.segment.is_first else True


def replay_mapper(
    recipe: Recipe,
    begin: Callable[[MapperParams], Mapper],
    segment: DriveSegment | None = None,
    *,
    is_shown: bool = True,
) -> MappedDrive:
    """Play a bag, or a segment of it, to a mapper; `is_shown`: with a bar."""
    segment, damages = segment or DriveSegment(), list[str]()
    bus = OfflineBus(captured={HEARD})
    stitching = add_stitcher(bus, recipe, segment)
    node = bus.add(SegmentMapper, recipe.values, recipe.remap)
    assert isinstance(node, SegmentMapper)
    node.segment, node.mapper = segment, begin(node.params.mapper)
    try:
        with BagReader(recipe.bag, damages=damages) as bag:
            hear_beginning(bag, node, recipe.remap.get("imu", ""))
            if recipe.pair is not None:
                node.intake.stereo.use(recipe.pair)
            play(bag, bus, segment, recipe.held, is_shown=is_shown)
        if stitching is not None:
            stitching.finish_open()
            stitching.publish_last()
            for _ in bus.settle():
                pass
    finally:
        if stitching is not None:
            stitching.cleanup()
    return MappedDrive(node.mapper, node.mount, node.num_lost, refusals(node, stitching), damages)


def add_stitcher(bus: OfflineBus, recipe: Recipe, segment: DriveSegment) -> StitcherAhead | None:
    """Put the stitcher before the mapper where there is a rig; a later segment begins with what is known of it."""
    if recipe.stitcher is None:
        return None
    values, remap = recipe.stitcher
    known = None if segment.is_first else recipe.rig
    node = bus.add(StitcherAhead, values if known is None else values | {"rectify.num_instants": 0}, remap)
    assert isinstance(node, StitcherAhead)
    node.segment = segment
    if known is not None:
        node.know(known)
    return node


def play(bag: BagReader, bus: OfflineBus, segment: DriveSegment, held: tuple[str, ...], *, is_shown: bool) -> None:
    """Play a segment of a bag."""
    total = sum(bag.topics[topic].count for topic in required_topics(bag, bus)) // segment.total
    name = f"map {segment.number + 1}/{segment.total}" if segment.total > 1 else "map"
    is_hidden = None if is_shown else True
    with tqdm(total=total, desc=name, unit="message", leave=False, disable=is_hidden) as bar:
        limits = {"start_ns": segment.begin_ns, "end_ns": segment.end_ns}
        for _ in replay(bag, bus, **limits, held=held, progress=bar.update):
            if any(node.is_done for node in bus.nodes if isinstance(node, SegmentMapper)):
                break


def refusals(node: SphereMapper, stitching: StitcherAhead | None) -> dict[str, int]:
    """Return how often something was refused or missing, by the words with {n} in the place of the number."""
    inputs = [*node.inputs, *(stitching.inputs if stitching else ())]
    found = {f"{{n}} of {one.topic}: {one.last_refusal}": one.num_refused for one in inputs if one.num_refused}
    if stitching is not None and stitching.intake is not None:
        for name, health in stitching.intake.sync.health.items():
            if health.problem:
                found[f"{name}: {health.problem} ({{n}} times)"] = health.num_missing
    return found


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
