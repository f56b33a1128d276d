"""`bag_player`: the messages of a bag, published again in the order and at the pace of recording."""

from __future__ import annotations

import struct
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any, cast

from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from node_kit import qos
from node_kit.bags import BagReader, Recorded, TopicInfo
from node_kit.conversions import ns_to_time
from node_kit.interfaces import message_class
from node_kit.live import LiveOutput, LiveShell
from node_kit.node import OK, WARN, ManagedNode
from node_kit.run import run
from typed_params import param, parameters

TICK = 0.005  # s
BUSY = 0.05  # s that one tick may publish before others get a turn
ACKNOWLEDGE = 5.0  # s to wait for listeners when playing as fast as they take it
CLOCK_PERIOD = 0.025  # s of wall time between two /clock messages


@parameters
class PlayerParams:
    """Parameters of `bag_player`."""

    bag: str = param("", "bag to play: a folder or an .mcap file")
    topics: str = param("", "topics to play, separated by spaces; empty: all")
    rate: float = param(1.0, "speed of playing; 0: as fast as listeners acknowledge", "x", low=0.0, high=1000.0)
    start: float = param(
        0.0, "begin so long after the first message; latched topics are played nevertheless", "s", low=0.0
    )
    clock: bool = param(False, "publish /clock, for nodes with use_sim_time")
    paused: bool = param(False, "wait for the service resume before playing")
    loop: bool = param(False, "begin again at the end")
    wait_for: str = param("", "topics, separated by spaces, that must have a listener before playing begins")
    answer_topic: str = param("", "go on after an answered message only when this topic has its stamp in its header")
    answered_topic: str = param("image_raw", "messages of this topic are answered on answer_topic")
    answer_timeout: float = param(5.0, "longest wait for an answer", "s", low=0.0)


class BagPlayer(ManagedNode):
    """Publishes with RELIABLE, which every listener can take; latched topics stay latched and come first."""

    NAME = "bag_player"
    PARAMS = PlayerParams
    LARGE_MESSAGES = True
    params: PlayerParams
    progress: Callable[[int, int], None] = staticmethod(lambda done, total: None)

    def configure(self) -> None:
        """Open the bag and its topics."""
        self.bag = BagReader(self.params.bag)
        self.outputs = {name: self._output(info) for name, info in self._chosen().items()}
        self.start_ns = self.bag.time_range[0] + round(self.params.start * 1e9)
        if self.start_ns > self.bag.time_range[1]:
            seconds = (self.bag.time_range[1] - self.bag.time_range[0]) / 1e9
            raise ValueError(
                f"start: expected less than the {seconds:.1f} s of {self.params.bag}, found {self.params.start}"
            )
        self.clock = self.announce("/clock", Clock, qos.STATE) if self.params.clock else None
        if self.params.answer_topic:
            self._listen_for_answers()
        self.is_paused, self.is_waiting = self.params.paused, bool(self.params.wait_for)
        self.answered_ns = 0
        self.serve("pause", Trigger, lambda request, response: self._set_paused(True, response))
        self.serve("resume", Trigger, lambda request, response: self._set_paused(False, response))
        self.every(TICK, self._tick, is_wall=True)
        self._rewind()

    def activate(self) -> None:
        """Tell latched topics at once: late listeners still get them."""
        latched = [name for name in self.outputs if _is_latched(self.bag.topics[name])]
        for topic, _, data in self.bag.raw(latched, end_ns=self.start_ns) if latched else ():
            self.outputs[topic].publish(data)

    def cleanup(self) -> None:
        """Close the bag."""
        self.bag.close()

    def _chosen(self) -> dict[str, TopicInfo]:
        if self.params.topics:
            names = [self.bag.require(name).name for name in self.params.topics.split()]
        else:
            names = [name for name, info in self.bag.topics.items() if info.count and name != "/clock"]
        chosen = {}
        for name in names:
            try:
                message_class(self.bag.topics[name].type)
                chosen[name] = self.bag.topics[name]
            except ValueError as error:
                self.log.warning(f"{name}: not played: {error}")
        if not chosen:
            raise ValueError(f"{self.params.bag}: expected topics whose types are installed, found none")
        return chosen

    def _output(self, info: TopicInfo) -> LiveOutput:
        depth = max([10, *(profile.depth for profile in info.profiles)])
        durability = qos.TRANSIENT_LOCAL if _is_latched(info) else qos.VOLATILE
        profile = QoSProfile(depth=min(depth, 100), reliability=qos.RELIABLE, durability=durability)
        return cast("LiveOutput", self.announce(info.name, message_class(info.type), profile))

    def _rewind(self) -> None:
        self.total = sum(self.bag.topics[name].count for name in self.outputs)
        self.done = 0
        self.stream: Iterator[Recorded] = self.bag.raw(list(self.outputs), self.start_ns)
        self.next: Recorded | None = next(self.stream, None)
        self.origin: tuple[float, int] | None = None  # wall time and stamp that belong together
        self.last_clock = 0.0

    def _tick(self) -> None:
        """Publish what is due."""
        if self.is_paused or (self.is_waiting and not self._has_listeners()):
            self.origin = None
            return
        end = time.monotonic() + BUSY
        if self.origin is None and self.next is not None:
            self.origin = (time.monotonic(), self.next.stamp_ns)
        while self.next is not None and self._is_due(self.next.stamp_ns) and time.monotonic() < end:
            if not self._is_answered():
                break
            self._publish(self.next)
            self.next = next(self.stream, None)
        self._tell_time()
        if self.next is None and self._is_answered():
            self._end()

    def _is_due(self, stamp: int) -> bool:
        return self.params.rate == 0 or stamp <= self._present_ns()

    def _present_ns(self) -> int:
        """Return the stamp that belongs to the wall time of now."""
        if self.origin is None or self.params.rate == 0:
            return self.next.stamp_ns if self.next else 0
        return self.origin[1] + round((time.monotonic() - self.origin[0]) * self.params.rate * 1e9)

    def _publish(self, item: Recorded) -> None:
        if self.clock is not None and self.params.rate == 0:
            self.clock.publish(Clock(clock=ns_to_time(item.stamp_ns)))
        output = self.outputs[item.topic]
        output.publish(item.message)
        if self.params.answer_topic and item.topic == self.answered_topic:
            self.expected_ns, self.expected_until = (
                _stamp_of(item.message),
                time.monotonic() + self.params.answer_timeout,
            )
        if self.params.rate == 0:
            output.wait_for_acknowledgement(ACKNOWLEDGE)
        self.done += 1
        self.progress(self.done, self.total)

    def _tell_time(self) -> None:
        now = time.monotonic()
        if self.clock is None or self.next is None or self.params.rate == 0 or now - self.last_clock < CLOCK_PERIOD:
            return
        self.last_clock = now
        self.clock.publish(Clock(clock=ns_to_time(min(self._present_ns(), self.next.stamp_ns))))

    def _has_listeners(self) -> bool:
        names = [self.bag.require(name).name for name in self.params.wait_for.split()]
        absent = [name for name in names if self.outputs[name].num_listeners == 0]
        text = f"waiting for a listener of {', '.join(absent)}" if absent else "playing"
        self.report("playing", WARN if absent else OK, text, done=self.done, total=self.total)
        if absent:
            self.log.info(text, every=5.0)
        self.is_waiting = bool(absent)
        return not absent

    def _listen_for_answers(self) -> None:
        self.answered_topic = self.bag.require(self.params.answered_topic).name
        self.expected_ns = self.expected_until = 0
        self.is_listening = False
        self.every(0.2, self._find_answers, is_wall=True)

    def _find_answers(self) -> None:
        """Subscribe to the answers as soon as their type is known."""
        ros = cast("LiveShell", self.shell)
        topic = ros.resolve_topic_name(self.params.answer_topic)
        kinds = dict(ros.get_topic_names_and_types()).get(topic)
        if kinds and not self.is_listening:
            self.is_listening = True
            self.listen(topic, message_class(kinds[0]), self._on_answer, qos.STATE, raw=True, is_required=False)

    def _on_answer(self, data: bytes) -> None:
        self.answered_ns = max(self.answered_ns, _stamp_of(data))

    def _is_answered(self) -> bool:
        if not self.params.answer_topic or self.answered_ns >= self.expected_ns:
            return True
        if time.monotonic() < self.expected_until:
            return False
        self.log.warning(f"no answer on {self.params.answer_topic} to stamp {self.expected_ns / 1e9:.3f} s", every=5.0)
        self.expected_ns = 0
        return True

    def _set_paused(self, is_paused: bool, response: Any) -> Any:
        self.is_paused = is_paused
        response.success, response.message = True, "paused" if is_paused else "playing"
        return response

    def _end(self) -> None:
        for output in self.outputs.values():
            output.wait_for_acknowledgement(1.0)
        if self.params.loop:
            self.answered_ns = 0
            self._rewind()
            return
        self.log.info(f"{self.params.bag}: {self.done} messages played")
        self.finish()


def _is_latched(info: TopicInfo) -> bool:
    return any(profile.durability == qos.TRANSIENT_LOCAL for profile in info.profiles)


def _stamp_of(data: bytes) -> int:
    """Return the stamp in ns of a serialized message that begins with a header (little-endian CDR)."""
    seconds, nanoseconds = struct.unpack_from("<iI", data, 4)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)


def main() -> int:
    """Run the node."""
    return run(BagPlayer)


if __name__ == "__main__":
    sys.exit(main())
