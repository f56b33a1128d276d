"""What `compare_results.py` does with the Python of an environment: bags to digests, a replay, the watch of a drive.

    python inside_environment.py digest BAG [--since S] [--until S]
    python inside_environment.py follow BAG TRAJECTORY --replay-module NAME...
    python inside_environment.py watch --until S [--start]

Each prints one line of JSON. It needs rclpy, mcap and the message packages; of the project's own modules it imports
only the one behind the entry point `path_follower`, and the replay of bags by one of the names that it is given.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import json
import math
import struct
import sys
import time
from array import array
from collections.abc import Iterable, Iterator
from importlib.metadata import entry_points
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from rclpy.serialization import deserialize_message

NS = 1_000_000_000
VOLATILE = {  # fields that tell how long it took, or by which program: no results
    "sphere_nav_msgs/msg/LocalizationStatus": {"milliseconds"},
    "sphere_nav_msgs/msg/KeySphereGraph": {"software"},
    "sphere_nav_msgs/msg/MapInfo": {"software", "parameters"},
}
BY_ITSELF = {"sphere_nav_msgs/msg/MapInfo": ("parameters",)}  # a digest of its own: names may change, results not
CALLS = {60: "pause", 90: "resume", 150: "stop", 230: "start"}  # of the operator, by the statuses after the first start
START_UP_S = 240.0  # of wall time without news; kernels may have to be compiled


class TopicDigest:
    """SHA-256 of the values of all messages of a topic, in the order of their stamps."""

    def __init__(self, type_name: str) -> None:
        self.type_name = type_name
        self.digests: list[tuple[int, bytes]] = []

    def add(self, message: Any) -> None:
        """Add a message."""
        sha = hashlib.sha256()
        update(sha, message, VOLATILE.get(self.type_name, set()))
        self.digests.append((stamp_ns(message), sha.digest()))

    def result(self) -> dict[str, Any]:
        """Return digest and number of messages."""
        ordered = sorted(self.digests, key=lambda item: item[0])  # stable: of one stamp, as recorded
        return {"sha256": hashlib.sha256(b"".join(digest for _, digest in ordered)).hexdigest(), "count": len(ordered)}


def update(sha: Any, value: Any, skipped: Iterable[str] = ()) -> None:
    """Add a value of a message: a bit, text or number with its kind, or the parts of a message or list.

    The bytes of a serialized message will not do: what is between two aligned fields is not defined.
    """
    if hasattr(value, "get_fields_and_field_types"):
        for name in value.get_fields_and_field_types():
            if name not in skipped:
                update(sha, getattr(value, name))
    elif isinstance(value, (array, np.ndarray)):
        data = np.asarray(value)
        sha.update(f"{data.dtype.str}{data.size}:".encode())
        sha.update(data.tobytes())
    elif isinstance(value, (bytes, bytearray)):
        sha.update(f"b{len(value)}:".encode())
        sha.update(value)
    elif isinstance(value, str):
        update(sha, value.encode())
    elif isinstance(value, (bool, int)):
        sha.update(f"i{int(value)}:".encode())
    elif isinstance(value, float):
        sha.update(struct.pack("<cd", b"f", value))
    else:
        items = list(value)
        sha.update(f"l{len(items)}:".encode())
        for item in items:
            update(sha, item)


def stamp_ns(message: Any) -> int:
    """Return the stamp of a message, 0 for one that has none."""
    header = getattr(message, "header", None)
    return 0 if header is None else header.stamp.sec * NS + header.stamp.nanosec


def message_class(type_name: str) -> type[Any]:
    """Return the class of a type such as sensor_msgs/msg/Image."""
    package, _, name = type_name.split("/")
    found: type[Any] = getattr(importlib.import_module(f"{package}.msg"), name)
    return found


def messages(bag: Path) -> Iterator[tuple[str, str, Any]]:
    """Yield topic, type and message of all files of a bag."""
    for path in sorted(bag.glob("*.mcap")):
        with path.open("rb") as file:
            for schema, channel, record in make_reader(file).iter_messages():
                assert schema is not None, channel.topic
                yield channel.topic, schema.name, deserialize_message(record.data, message_class(schema.name))


def digest(bag: Path, since: float, until: float) -> dict[str, Any]:
    """Return the digests of all topics of a bag, of messages stamped within an interval, s."""
    topics: dict[str, TopicDigest] = {}
    for topic, type_name, message in messages(bag):
        if not since * NS <= stamp_ns(message) <= until * NS:
            continue
        topics.setdefault(topic, TopicDigest(type_name)).add(message)
        for field in BY_ITSELF.get(type_name, ()):
            topics.setdefault(f"{topic}.{field}", TopicDigest("")).add(getattr(message, field))
    return {topic: topics[topic].result() for topic in sorted(topics)}


def entry_module(name: str) -> Any:
    """Return the module of an executable, as it is installed."""
    found = entry_points(group="console_scripts", name=name)
    if not found:
        raise SystemExit(f"{name}: expected an installed executable of this name, found none")
    return importlib.import_module(next(iter(found)).module)


def installed(name: str) -> Any:
    """Return a module, None where there is none of this name."""
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name and not f"{name}.".startswith(f"{error.name}."):
            raise  # it is there, but lacks another one
        return None


def first_module(names: Iterable[str]) -> Any:
    """Return the first module of some that is installed."""
    found = next(filter(None, map(installed, names)), None)
    if found is None:
        raise SystemExit(f"expected one of the modules {', '.join(names)}, found none")
    return found


def follow(bag: Path, trajectory: Path, names: Iterable[str], source: str) -> dict[str, Any]:
    """Replay a recorded drive through path_follower, as an operator would use it; return what it published."""
    module, replaying = entry_module("path_follower"), first_module(names)
    node_class = next(
        value
        for value in vars(module).values()
        if isinstance(value, type) and getattr(value, "NAME", "") == "path_follower"
    )
    near = replaying.__name__.rpartition(".")[0]
    readers = [replaying, *(installed(f"{near}.{name}") for name in ("bag_reader", "reader"))]
    bag_reader = next(module.BagReader for module in readers if hasattr(module, "BagReader"))
    bus = replaying.OfflineBus()
    values = {"trajectory": str(trajectory), "enable_stamped_cmd_vel": True, "source": source}
    node = bus.add(node_class, values)
    topics: dict[str, TopicDigest] = {}
    speeds, states, refusal, begun = [0.0], [""], "no status", 0
    with bag_reader(bag) as reader:
        for item in replaying.replay(reader, bus):
            package, name = type(item.message).__module__.split(".")[0], type(item.message).__name__
            topics.setdefault(item.topic, TopicDigest(f"{package}/msg/{name}")).add(item.message)
            if item.topic == "/cmd_vel":
                speeds.append(item.message.twist.linear.x)
            elif item.topic == "/path_follower/status":
                states.append(f"{item.message.state} {item.message.reason}".strip())
                if refusal:
                    answer = node.shell.call("start")
                    refusal, begun = "" if answer.success else answer.message, len(states)
                elif len(states) - begun in CALLS:
                    node.shell.call(CALLS[len(states) - begun])
    if refusal:
        raise SystemExit(f"path_follower: expected a start, found it refused to the end: {refusal}")
    passed = [state for before, state in pairwise(states) if state != before]
    figures = {"fastest_m_s": max(speeds), "states": ", ".join(passed)}
    return {"topics": {topic: topics[topic].result() for topic in sorted(topics)}, "figures": figures}


def watch(until: float, *, has_start: bool) -> dict[str, Any]:
    """Wait until simulated time, s, or until the follower has ended, which is started once the camera is localised."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    kinds: list[Any] = [
        message_class(name) for name in ("rosgraph_msgs/msg/Clock", "sphere_nav_msgs/msg/FollowerStatus")
    ]
    trigger = importlib.import_module("std_srvs.srv").Trigger

    rclpy.init()
    node = rclpy.create_node("watch")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    seen: dict[str, Any] = {"time_s": 0.0, "follower": ""}

    def on_clock(message: Any) -> None:
        seen["time_s"] = message.clock.sec + message.clock.nanosec / NS

    def on_status(message: Any) -> None:
        seen["follower"] = message.state

    node.create_subscription(kinds[0], "/clock", on_clock, 10)
    node.create_subscription(kinds[1], "path_follower/status", on_status, 10)
    client, answer, wait_until = node.create_client(trigger, "path_follower/start"), None, 0.0
    is_started = not has_start
    heard, told = time.monotonic(), dict(seen)
    while seen["time_s"] < until and not (is_started and seen["follower"] in ("FINISHED", "STOPPED")):
        executor.spin_once(timeout_sec=0.1)
        if seen != told:
            heard, told = time.monotonic(), dict(seen)
        if time.monotonic() - heard > START_UP_S:
            raise SystemExit(f"nothing for {START_UP_S:.0f} s; last {seen}")
        if answer is not None and answer.done():
            is_started, answer = bool(answer.result().success), None
            wait_until = time.monotonic() + 0.5
        if not is_started and answer is None and seen["follower"] == "IDLE" and time.monotonic() > wait_until:
            answer = client.call_async(trigger.Request())
    rclpy.try_shutdown()
    return seen


def main() -> None:
    """Do one of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    digesting = commands.add_parser("digest")
    digesting.add_argument("bag", type=Path)
    digesting.add_argument("--since", type=float, default=0.0)
    digesting.add_argument("--until", type=float, default=math.inf)
    following = commands.add_parser("follow")
    following.add_argument("bag", type=Path)
    following.add_argument("trajectory", type=Path)
    following.add_argument("--source", default="pose")
    following.add_argument("--replay-module", nargs="+", required=True)
    watching = commands.add_parser("watch")
    watching.add_argument("--until", type=float, required=True)
    watching.add_argument("--start", action="store_true")
    given = parser.parse_args()
    if given.command == "digest":
        result = digest(given.bag, given.since, given.until)
    elif given.command == "follow":
        result = follow(given.bag, given.trajectory, given.replay_module, given.source)
    else:
        result = watch(given.until, has_start=given.start)
    sys.stdout.write(f"\n{json.dumps(result)}\n")


if __name__ == "__main__":
    main()
