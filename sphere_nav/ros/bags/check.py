"""Check a bag message by message; rescue what is readable of a damaged one."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import Any

from sphere_nav.ros import qos
from sphere_nav.ros.bags.mcap_file import whole_messages
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.recorded import SALVAGE, SQLITE, BagError, TopicInfo
from sphere_nav.ros.bags.writer import BagWriter
from sphere_nav.ros.interfaces import message_class

Progress = Callable[[int], None]
SALVAGING = ".salvaging"  # not `.partial`: that is often the source


def verify_bag(bag: BagReader, progress: Progress = lambda step: None) -> tuple[int, list[str]]:
    """Read every message, deserialize those whose type is installed; return their number, and problems, one a line."""
    problems: list[str] = []
    kinds = {name: _class_of(info) for name, info in bag.topics.items()}
    counts = dict.fromkeys(bag.topics, 0)
    try:
        for topic, _, data in bag.raw():
            counts[topic] += 1
            kind = kinds[topic]
            if kind is not None:
                bag.decode(topic, data, kind)
            progress(1)
    except BagError as error:
        problems.append(str(error))
    for name, info in bag.topics.items():
        if counts[name] != info.count and not problems:
            problems.append(f"{bag.path}: {name}: expected {info.count} messages (summary), found {counts[name]}")
    num_messages = sum(counts.values())
    if num_messages == 0:
        problems.append(f"{bag.path}: expected messages, found an empty bag")
    return num_messages, problems


def salvage(source: Path, target: Path, progress: Progress = lambda step: None) -> int:
    """Copy what is whole of a damaged bag into a new bag; return the number of messages."""
    files = [source] if source.is_file() else sorted(source.glob("*.mcap"))
    if any(file.suffix == SQLITE for file in files or source.glob(f"*{SQLITE}")):
        raise BagError(f"{source}: expected an .mcap file to salvage, found sqlite3: {SALVAGE}")
    if not files:
        raise BagError(f"{source}: expected an .mcap file or a folder with one, found none")
    with BagWriter(target, suffix=SALVAGING) as bag:
        for schema, channel, message in chain.from_iterable(map(whole_messages, files)):
            profile = qos.from_yaml(channel.metadata.get("offered_qos_profiles", ""))
            with suppress(BagError):  # of two types on a topic the first one
                bag.add_topic(channel.topic, schema.name, profile, schema=schema)
                bag.write_bytes(channel.topic, message.data, message.log_time, published=message.publish_time)
                progress(1)
        if not bag.num_messages:
            raise BagError(f"{source}: expected a whole chunk to salvage, found none")
    return bag.num_messages


def _class_of(info: TopicInfo) -> type[Any] | None:
    try:
        return message_class(info.type)
    except ValueError:
        return None  # a type that is not installed here is no fault of the bag
