"""`bag_player`: the messages of a bag, published again in the order and at the pace of recording."""

from __future__ import annotations

import time

from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock

from sphere_nav.params import param, parameters
from sphere_nav.ros import qos
from sphere_nav.ros.bags import BagReader, Recorded, TopicInfo
from sphere_nav.ros.constants import (
    ACKNOWLEDGE_S,
    ACKNOWLEDGED_SIZE,
    CLOCK_PERIOD,
    LOG_PERIOD_S,
    PLAY_BUSY,
    PLAY_TICK,
    SETTLE,
)
from sphere_nav.ros.conversions import ns_to_time
from sphere_nav.ros.interfaces import message_class
from sphere_nav.ros.node import OK, WARN, ManagedNode, Publisher
from sphere_nav.ros.run import run


@parameters
class PlayerParams:
    """Parameters of `bag_player`."""

    bag: str = param("", "bag to play: a folder or an .mcap file")
    topics: str = param("", "topics to play, separated by spaces; empty: all")
    rate: float = param(1.0, "speed of playing; 0: as fast as listeners acknowledge", "x", low=0.0, high=1000.0)
    start: float = param(0.0, "begin so long after the first message; latched topics come first", "s", low=0.0)
    clock: bool = param(False, "publish /clock, for nodes with use_sim_time")
    wait_for: str = param("", "topics, separated by spaces, that must have a listener before playing begins")


class BagPlayer(ManagedNode):
    """Publishes with RELIABLE, which every listener can take; latched topics stay latched and come first."""

    NAME = "bag_player"
    PARAMS = PlayerParams
    LARGE_MESSAGES = True
    params: PlayerParams

    def configure(self) -> None:
        """Open the bag and its topics."""
        if not self.params.bag:
            raise ValueError("bag: expected a folder or an .mcap file to play, found none")
        self.bag = BagReader(self.params.bag)
        chosen = self._choose()
        begin_ns, end_ns = self.bag.time_range
        self.start_ns = begin_ns + round(self.params.start * 1e9)
        if self.start_ns > end_ns:
            length = (end_ns - begin_ns) / 1e9
            raise ValueError(f"start: expected at most {length:.3f} s ({self.params.bag}), found {self.params.start}")
        self.outputs = {name: self._output(info) for name, info in chosen.items()}
        self.latched = {name for name, info in chosen.items() if info.profile.durability == qos.TRANSIENT_LOCAL}
        later = self.bag.raw(chosen, self.start_ns)
        self.messages = (one for one in later if one.topic not in self.latched or one.stamp_ns > self.start_ns)
        self.next: Recorded | None = next(self.messages, None)
        self.total, self.done = sum(info.count for info in chosen.values()), 0
        self.origin: tuple[float, int] | None = None  # wall time and stamp that belong together
        self.wait_for = {self._play(name) for name in self.params.wait_for.split()}
        self.begin_at = 0.0
        self.add_timer(PLAY_TICK, self._tick, is_wall=True)
        self.clock = self.add_publisher("/clock", Clock, qos.STATE) if self.params.clock else None
        if self.clock is not None:
            self.add_timer(CLOCK_PERIOD, self._tell_time, is_wall=True)

    def activate(self) -> None:
        """Tell latched topics at once: late listeners still get them."""
        if self.latched:
            for item in self.bag.raw(self.latched, end_ns=self.start_ns):  # they hold from the start on
                self.outputs[item.topic].publish(item.message)

    def progress(self, done: int, total: int) -> None:
        """Show how many messages are played."""

    def cleanup(self) -> None:
        """Close the bag."""
        self.bag.close()

    # --- topics
    def _choose(self) -> dict[str, TopicInfo]:
        names = [self.bag.require(name).name for name in self.params.topics.split()]
        chosen = {}
        for name in names or [name for name, info in self.bag.topics.items() if info.count and name != "/clock"]:
            try:
                message_class(self.bag.topics[name].type)
                chosen[name] = self.bag.topics[name]
            except ValueError as error:
                self.log.warning(f"{name}: not played: {error}")
        if not chosen:
            raise ValueError(f"{self.params.bag}: expected topics whose types are installed, found none")
        return chosen

    def _output(self, info: TopicInfo) -> Publisher:
        depth = 10 if self.params.rate else 1000  # small messages pile up before they are acknowledged
        profile = QoSProfile(depth=depth, reliability=qos.RELIABLE, durability=info.profile.durability)
        name = info.name.lstrip("/")  # in a namespace all that a vehicle recorded goes below it
        return self.add_publisher(name, message_class(info.type), profile)

    def _play(self, topic: str) -> str:
        name = self.bag.require(topic).name
        if name not in self.outputs:
            raise ValueError(f"{topic}: expected a topic that is played ({', '.join(self.outputs)})")
        return name

    # --- playing
    def _tick(self) -> None:
        """Publish what is due."""
        if self._lacks_listeners():
            return
        end = time.monotonic() + PLAY_BUSY
        while time.monotonic() < end and (item := self.take()) is not None:
            self._publish(item)
            self.progress(self.done, self.total)
        if self.next is None:
            self._end()

    def take(self) -> Recorded | None:
        """Return the next message if it is due, with rate 0 at once, and go on to the one after it."""
        item = self.next
        if item is not None and self.origin is None:
            self.origin = time.monotonic(), item.stamp_ns
        if item is None or item.stamp_ns > self.present_ns(item):
            return None
        self.done, self.next = self.done + 1, next(self.messages, None)
        return item

    def present_ns(self, following: Recorded) -> int:
        """Return the time in the bag, never beyond the message that follows."""
        if self.origin is None or not self.params.rate:
            return following.stamp_ns
        since, stamp_ns = self.origin
        return min(stamp_ns + round((time.monotonic() - since) * self.params.rate * 1e9), following.stamp_ns)

    def _publish(self, item: Recorded) -> None:
        if self.clock is not None and self.params.rate == 0:
            self.clock.publish(Clock(clock=ns_to_time(item.stamp_ns)))
        output = self.outputs[item.topic]
        output.publish(item.message)
        if self.params.rate == 0 and len(item.message) > ACKNOWLEDGED_SIZE:
            output.wait_for_acknowledgement(ACKNOWLEDGE_S)

    def _tell_time(self) -> None:
        if self.clock is not None and self.next is not None:
            self.clock.publish(Clock(clock=ns_to_time(self.present_ns(self.next))))

    def _lacks_listeners(self) -> bool:
        absent = sorted(name for name in self.wait_for if not self.outputs[name].num_subscriptions)
        text = f"waiting for a listener of {', '.join(absent)}" if absent else "playing"
        values = {"done": self.done, "total": self.total}
        self.endpoints.tell("player", WARN if absent else OK, text, text * bool(absent), every=LOG_PERIOD_S, **values)
        if absent:
            self.begin_at = time.monotonic() + SETTLE
            return True
        self.wait_for.clear()  # for the start only
        return time.monotonic() < self.begin_at

    def _end(self) -> None:
        for output in self.outputs.values():
            output.wait_for_acknowledgement(ACKNOWLEDGE_S)
        self.log.info(f"{self.params.bag}: {self.done} messages played")
        self.endpoints.finish(0)


def main() -> int:
    """Run the node."""
    return run(BagPlayer)
