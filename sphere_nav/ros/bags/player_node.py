"""`bag_player`: the messages of a bag, published again in the order and at the pace of recording."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from sphere_nav.params import param, parameters
from sphere_nav.ros import qos
from sphere_nav.ros.bags import BagReader, Recorded, TopicInfo
from sphere_nav.ros.bags.playback import Playback, is_latched
from sphere_nav.ros.constants import (
    ACKNOWLEDGE_S,
    ACKNOWLEDGED_SIZE,
    CLOCK_PERIOD,
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
    progress: Callable[[int, int], None] = staticmethod(lambda done, total: None)

    def configure(self) -> None:
        """Open the bag and its topics."""
        if not self.params.bag:
            raise ValueError("bag: expected a folder or an .mcap file to play, found none")
        self.bag = BagReader(self.params.bag)
        chosen = self._choose()
        start_ns, end_ns = self.bag.time_range
        if start_ns + self.params.start * 1e9 > end_ns:
            length = (end_ns - start_ns) / 1e9
            raise ValueError(f"start: expected at most {length:.3f} s ({self.params.bag}), found {self.params.start}")
        self.playback = Playback(self.bag, list(chosen), start_ns + round(self.params.start * 1e9), self.params.rate)
        self.outputs = {name: self._output(info) for name, info in chosen.items()}
        self.clock = self.add_publisher("/clock", Clock, qos.STATE) if self.params.clock else None
        self.clock_told = 0.0
        self.wait_for = {self._play(name) for name in self.params.wait_for.split()}
        self.is_paused, self.begin_at = False, 0.0
        self.add_service("~/pause", Trigger, lambda request, response: self._set_paused(True, response))
        self.add_service("~/resume", Trigger, lambda request, response: self._set_paused(False, response))
        self.add_timer(PLAY_TICK, self._tick, is_wall=True)

    def activate(self) -> None:
        """Tell latched topics at once: late listeners still get them."""
        for item in self.playback.latched():
            self.outputs[item.topic].publish(item.message)

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
        is_paced = self.params.rate > 0
        depth = 10 if is_paced else 1000  # as fast as possible, small messages pile up before they are acknowledged
        durability = qos.TRANSIENT_LOCAL if is_latched(info) else qos.VOLATILE
        profile = QoSProfile(depth=depth, reliability=qos.RELIABLE, durability=durability)
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
        if self.is_paused or self._lacks_listeners():
            self.playback.pause()
            return
        end = time.monotonic() + PLAY_BUSY
        while time.monotonic() < end and (item := self.playback.take()) is not None:
            self._publish(item)
            self.progress(self.playback.done, self.playback.total)
        self._tell_time()
        if self.playback.next is None:
            self._end()

    def _publish(self, item: Recorded) -> None:
        if self.clock is not None and self.params.rate == 0:
            self.clock.publish(Clock(clock=ns_to_time(item.stamp_ns)))
        output = self.outputs[item.topic]
        output.publish(item.message)
        if self.params.rate == 0 and len(item.message) > ACKNOWLEDGED_SIZE:
            output.wait_for_acknowledgement(ACKNOWLEDGE_S)

    def _tell_time(self) -> None:
        now = time.monotonic()
        if self.clock is not None and self.playback.next is not None and now - self.clock_told >= CLOCK_PERIOD:
            self.clock_told = now
            self.clock.publish(Clock(clock=ns_to_time(self.playback.present_ns())))

    def _lacks_listeners(self) -> bool:
        absent = sorted(name for name in self.wait_for if not self.outputs[name].num_subscriptions)
        text = f"waiting for a listener of {', '.join(absent)}" if absent else "playing"
        self.report("player", WARN if absent else OK, text, done=self.playback.done, total=self.playback.total)
        if absent:
            self.log.info(text, every=10.0)
            self.begin_at = time.monotonic() + SETTLE
            return True
        self.wait_for.clear()  # for the start only
        return time.monotonic() < self.begin_at

    def _set_paused(self, is_paused: bool, response: Any) -> Any:
        self.is_paused = is_paused
        response.success, response.message = True, "paused" if is_paused else "playing"
        return response

    def _end(self) -> None:
        for output in self.outputs.values():
            output.wait_for_acknowledgement(ACKNOWLEDGE_S)
        self.log.info(f"{self.params.bag}: {self.playback.done} messages played")
        self.endpoints.finish(0)


def main() -> int:
    """Run the node."""
    return run(BagPlayer)
