"""Check a bag message by message; rescue what is readable of a damaged one."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
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


@dataclass
class BagReport:
    """What `verify_bag` found; a bag without problems is good."""

    path: Path
    num_messages: int = 0
    time_range: tuple[int, int] = (0, 0)
    topics: dict[str, TopicInfo] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)


def verify_bag(path: str | Path, progress: Progress = lambda step: None) -> BagReport:
    """Read every message of a bag and deserialize those whose type is installed; BagError if it cannot be opened."""
    report = BagReport(Path(path))
    with BagReader(path, is_empty_allowed=True) as bag:
        report.topics, report.time_range = bag.topics, bag.time_range
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
            report.problems.append(str(error))
        report.num_messages = sum(counts.values())
        for name, info in bag.topics.items():
            if counts[name] != info.count and not report.problems:
                report.problems.append(
                    f"{path}: {name}: expected {info.count} messages (summary), found {counts[name]}"
                )
        if report.num_messages == 0:
            report.problems.append(f"{path}: expected messages, found an empty bag")
    return report


def salvage(source: str | Path, target: str | Path, progress: Progress = lambda step: None) -> int:
    """Copy what is whole of a damaged bag into a new bag; return the number of messages."""
    source = Path(source)
    files = [source] if source.is_file() else sorted(source.glob("*.mcap"))
    if any(file.suffix == SQLITE for file in files or source.glob(f"*{SQLITE}")):
        raise BagError(f"{source}: expected an .mcap file to salvage, found sqlite3: {SALVAGE}")
    if not files:
        raise BagError(f"{source}: expected an .mcap file or a folder with one, found none")
    with BagWriter(target, suffix=SALVAGING) as bag:
        for schema, channel, message in chain.from_iterable(map(whole_messages, files)):
            offers = qos.from_yaml(channel.metadata.get("offered_qos_profiles", ""))
            with suppress(BagError):  # of two types on a topic the first one
                bag.add_topic(channel.topic, schema.name, *offers, schema=schema)
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
