"""Maps of earlier formats: what was different, one function each, and a new map in the present format.

A message of an old map is read by the definition that its file holds, so that fields may have come since: those have
their defaults. Then each step that the map needs changes it, in order. A new format raises MapInfo.FORMAT_VERSION,
adds a step here where old values mean something else, and a map of the format before to the test.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mcap.records import Schema
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from sphere_nav_msgs.msg import AugmentedSphere, KeySphereGraph, MapExperience, MapInfo

from sphere_nav.geometry.files.limits import LIMITS
from sphere_nav.geometry.files.untrusted import load_yaml
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.conversions import message_to_sphere, sphere_to_message
from sphere_nav.ros.conversions.graphs import message_to_graph, messages_to_experiences
from sphere_nav.ros.interfaces import message_class, type_name
from sphere_nav.ros.maps.writer import (
    EXPERIENCE,
    FILE_NAME,
    GRAPH,
    INFO,
    SPHERE,
    SPHERE_FRAME,
    MapDetails,
    MapWriter,
    Progress,
)
from sphere_nav.spheres.coarse import coarse_sphere
from sphere_nav.spheres.sphere import Sphere

MAX_DEFINITION = 1 << 16  # bytes of the definition of a message
MAX_ARRAY = 64  # elements of a fixed array in one; a covariance has 36


@dataclass(frozen=True)
class MapLayout:
    """What a map is written in: its version."""

    version: int

    @property
    def is_current(self) -> bool:
        """Whether it is read as it is."""
        return self.version == int(MapInfo.FORMAT_VERSION)


def _code_deviation_by_ratio(message: AugmentedSphere) -> None:
    """Format 1: the deviation of the range was coded as the range is."""
    if message.range_deviation_encoding:
        message_of_deviation = AugmentedSphere(
            header=message.header,
            info=message.info,
            image_encoding=message.image_encoding,
            image=message.image,
            range_encoding=message.range_deviation_encoding,
            range=message.range_deviation,
        )
        deviation = message_to_sphere(message_of_deviation).range_m
        _recode(message, replace(_without_deviation(message), range_std_m=deviation))


STEPS: tuple[tuple[Callable[[MapLayout], bool], Callable[[AugmentedSphere], None]], ...] = (
    (lambda layout: layout.version < 2, _code_deviation_by_ratio),
)
"""Which maps need a step, and what it changes in each of their key spheres; in order of the formats."""


def read_layout(path: str | Path) -> MapLayout:
    """Return what a map is written in; BagError where it is none, or of a version to come."""
    with BagReader(_file(path)) as bag:
        return OldMap(bag, Path(path)).layout


def migrate_map(source: str | Path, target: str | Path, progress: Progress = lambda step: None) -> int:
    """Write a map of any format anew in the present one; return how many key spheres. BagError for whatever is wrong.

    Small spheres and what spheres look like are made anew; pictures and ranges stay as they are, bit by bit.
    """
    with BagReader(_file(source)) as bag:
        old = OldMap(bag, Path(source))
        writer = MapWriter(target, old.details)
        try:
            writer.tell(old.graph)
            for message in old.spheres():
                sphere = message_to_sphere(message)
                small = sphere_to_message(coarse_sphere(sphere), SPHERE_FRAME, int(message.id))
                writer.copy((message, small))
                progress(1)
            writer.finish(old.graph)
        except ValueError as error:
            writer.discard()
            raise error if isinstance(error, BagError) else BagError(f"{source}: {error}") from None
        except BaseException:
            writer.discard()
            raise
    return len(old.graph)


def _file(path: str | Path) -> Path:
    return Path(path) / FILE_NAME if Path(path).is_dir() else Path(path)


class OldMap:
    """An open map of any format so far: its layout, graph and details; its key spheres in the present format."""

    def __init__(self, bag: BagReader, path: Path) -> None:
        self._bag, self._path = bag, path
        if not bag.files:
            raise BagError(f"{path}: expected a map, a bag in MCAP, found another one")
        self._schemas = {schema.name: schema for schema in bag.files[0].summary.schemas.values()}
        info = self._last(INFO, MapInfo)
        self.layout = MapLayout(int(info.format_version))
        if not 1 <= self.layout.version <= MapInfo.FORMAT_VERSION:
            expected = f"1 to {MapInfo.FORMAT_VERSION}"
            raise BagError(f"{path}: format_version: expected {expected}, found {self.layout.version}")
        if (number := int(info.num_spheres)) > LIMITS["map"]:
            raise BagError(f"{path}: num_spheres: expected at most {LIMITS['map']}, found {number}")
        message = self._last(GRAPH, KeySphereGraph)
        try:
            has_experiences = type_name(MapExperience) in self._schemas and EXPERIENCE in bag.topics
            items = bag.raw([EXPERIENCE]) if has_experiences else ()
            told = [self._decode(item.message, MapExperience) for item in items]
            self.graph = messages_to_experiences(message_to_graph(message), told)
            values = load_yaml(f"{path}: parameters", info.parameters) or {}
        except ValueError as error:
            raise BagError(f"{path}: {error}") from None
        parameters = values if isinstance(values, dict) else {}
        self.details = MapDetails(
            info.map_id, info.software, info.source, parameters, info.rig, message.header.frame_id
        )

    def spheres(self) -> Iterator[AugmentedSphere]:
        """Yield the key spheres, each of which the graph must know."""
        for item in self._bag.raw([SPHERE]):
            message = self._decode(item.message, AugmentedSphere)
            if int(message.id) not in self.graph.nodes:
                raise BagError(f"{self._path}: key sphere {message.id}: expected one of the graph, found another")
            for is_needed, step in STEPS:
                if is_needed(self.layout):
                    step(message)
            yield message

    def _last(self, topic: str, kind: type[Any]) -> Any:
        self._bag.require(topic, kind)
        return self._decode(list(self._bag.raw([topic]))[-1].message, kind)

    def _schema(self, kind: type[Any]) -> Schema:
        name = type_name(kind)
        if name not in self._schemas or len(self._schemas[name].data) > MAX_DEFINITION:
            raise BagError(f"{self._path}: expected the definition of {name}, found none")
        return self._schemas[name]

    def _decode(self, data: bytes, kind: type[Any]) -> Any:
        try:
            return decode_by(self._schema(kind).data.decode(), data, kind)
        except BagError:
            raise
        except Exception as error:  # whatever a file of anyone leads to
            what = " ".join(str(error).split())
            raise BagError(f"{self._path}: expected {type_name(kind)} by its own definition, found {what}") from None


def decode_by(definition: str, data: bytes, kind: type[Any]) -> Any:
    """Return a message that was written by an earlier definition of its type, a `ros2msg` schema.

    Fields that it did not have stand at their defaults; those that are gone are dropped.
    """
    if any(int(size) > MAX_ARRAY for size in re.findall(r"\[<?=?(\d{1,20})\]", definition)):
        raise ValueError(f"an array of a fixed size above {MAX_ARRAY}")  # which would be made before any byte is read
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, type_name(kind)))
    return _adopt(kind(), store.deserialize_cdr(data, type_name(kind)))


def _adopt(message: Any, found: Any) -> Any:
    """Return `message` with the values of all its fields that `found` has, too."""
    for name, kind in message.get_fields_and_field_types().items():
        if not hasattr(found, name):
            continue
        value, own = getattr(found, name), getattr(message, name)
        if hasattr(own, "get_fields_and_field_types"):
            _adopt(own, value)
        elif isinstance(own, array):
            setattr(message, name, array(own.typecode, value.tobytes()))
        elif isinstance(own, list):
            setattr(message, name, [_adopt(_element(kind), item) for item in value])
        else:
            setattr(message, name, value)
    return message


def _element(kind: str) -> Any:
    """Return an empty message of a sequence<package/Type>."""
    package, name = kind.removeprefix("sequence<").removesuffix(">").split("/")
    return message_class(f"{package}/msg/{name}")()


def _without_deviation(message: AugmentedSphere) -> Sphere:
    """Return the sphere of a message without its deviation."""
    encoding, message.range_deviation_encoding = message.range_deviation_encoding, ""
    try:
        return message_to_sphere(message)
    finally:
        message.range_deviation_encoding = encoding


def _recode(message: AugmentedSphere, sphere: Sphere) -> None:
    """Put the deviation of a sphere into its message, in the present code."""
    coded = sphere_to_message(
        sphere, SPHERE_FRAME, range_encoding=message.range_encoding or AugmentedSphere.RANGE_LOG16
    )
    message.range_deviation_encoding, message.range_deviation = coded.range_deviation_encoding, coded.range_deviation
