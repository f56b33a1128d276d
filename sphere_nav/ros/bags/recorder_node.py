"""`bag_recorder`: topics into a rosbag2 MCAP bag, as bytes, with the QoS that their publishers offer."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import ClassVar, cast

from rclpy.qos import QoSProfile

from sphere_nav.params import param, parameters
from sphere_nav.ros import qos
from sphere_nav.ros.bags import BagError, BagWriter
from sphere_nav.ros.bags.writer import free_path
from sphere_nav.ros.constants import FLUSH_PERIOD, LOG_PERIOD_S, RECORDER_QUEUE, TOPICS_PERIOD
from sphere_nav.ros.interfaces import message_class
from sphere_nav.ros.live import LiveShell
from sphere_nav.ros.node import OK, WARN, ManagedNode
from sphere_nav.ros.run import run
from sphere_nav.ros.service import one_line
from sphere_nav.ros.subscription import Subscription

ALL = "all"
SENSORS = {
    "nav_msgs/msg/Odometry",
    "sensor_msgs/msg/CameraInfo",
    "sensor_msgs/msg/CompressedImage",
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/Imu",
    "sensor_msgs/msg/LaserScan",
    "tf2_msgs/msg/TFMessage",
}
SETS = (ALL, "raw")


@parameters
class RecorderParams:
    """Parameters of `bag_recorder`."""

    output: str = param("", "folder of the bag to write; where it exists, NAME_2, NAME_3, ...")
    topics: str = param("", "topics to record, separated by spaces")
    topic_set: str = param("", "record every topic, or the raw ones: those of sensors", choices=("", *SETS))
    compressed: bool = param(True, "compress with zstd; not worth it for raw images of a noisy camera")


class BagRecorder(ManagedNode):
    """Looks for wanted topics all the time; what is recorded survives a crash but for the last five seconds."""

    NAME = "bag_recorder"
    PARAMS = RecorderParams
    PATIENCE: ClassVar[float] = 8.0  # s for a slow disk; `ros2 launch` kills 10 s after its SIGINT
    params: RecorderParams

    def configure(self) -> None:
        """Open the bag."""
        if not self.params.output:
            raise ValueError("output: expected the folder of the bag to write, found none")
        if not self.params.topics.split() and not self.params.topic_set:
            raise ValueError("topics, topic_set: expected something to record, found neither")
        self.ros = cast("LiveShell", self.endpoints)
        self.bag = BagWriter(free_path(Path(self.params.output)), is_compressed=self.params.compressed)
        if self.bag.path != Path(self.params.output):
            self.log.warning(f"{self.params.output}: something is there already: this recording is {self.bag.path}")
        self.recorded: dict[str, Subscription] = {}
        self.wanted = {self.ros.resolve_topic_name(name) for name in self.params.topics.split()}
        self.add_timer(TOPICS_PERIOD, self._look, is_wall=True)
        self.add_timer(FLUSH_PERIOD, partial(self._attempt, self.bag.flush), is_wall=True)
        self.log.info(f"recording into {self.bag.partial}, named {self.bag.path} when it is complete")

    def activate(self) -> None:
        """Subscribe to what is there already."""
        self._look()

    def deactivate(self) -> None:
        """Record what has come and waits for its turn: its publisher knows that it arrived, and may be gone."""
        for wanted in self.recorded.values():
            self.ros.take_waiting(wanted)

    def cleanup(self) -> None:
        """Complete the bag."""
        missing = sorted(self.wanted - {topic for topic, wanted in self.recorded.items() if wanted.num_received})
        if missing:
            self.log.warning(f"nothing came on {', '.join(missing)}")
        for line in self._losses():
            self.log.warning(line)
        try:
            path = self.bag.close()
        except (BagError, OSError) as error:
            self.log.error(f"{self.unfinished()}: {one_line(error)}")
        else:
            self.log.info(f"{path}: {self.bag.num_messages} messages on {len(self.recorded)} topics")

    def unfinished(self) -> str:
        """Return that the bag is not complete, and the command that rescues it."""
        if not hasattr(self, "bag") or not self.bag.partial.exists():
            return ""
        return f"{self.bag.partial}: not complete; '{self.bag.salvage_command}' keeps what is whole"

    def _look(self) -> None:
        """Subscribe to wanted topics that have a publisher, and anew where the QoS of those has changed."""
        for topic, kinds in self.ros.get_topic_names_and_types():
            if topic in self.wanted or any(belongs(topic, kind, self.params.topic_set) for kind in kinds):
                offers = [info.qos_profile for info in self.ros.get_publishers_info_by_topic(topic)]
                if offers:
                    self._subscribe(topic, kinds[0], offers)
        absent = sorted(self.wanted - self.recorded.keys())
        text = f"waiting for a publisher of {', '.join(absent)}" if absent else f"{len(self.recorded)} topics"
        losses = self._losses()
        words = "; ".join([text, *losses])
        change = " ".join([*absent, *(line.split()[0] for line in losses)])
        level, num_messages = WARN if change else OK, self.bag.num_messages
        self.endpoints.tell("recording", level, words, change, every=LOG_PERIOD_S, messages=num_messages)

    def _losses(self) -> list[str]:
        """Return a line for each topic of which messages were published that never arrived."""
        lossy = {topic: wanted for topic, wanted in self.recorded.items() if wanted.num_lost}
        return [
            f"{topic}: {wanted.num_lost} of {total} messages lost ({wanted.num_lost / total:.1%})"
            for topic, wanted in sorted(lossy.items())
            if (total := wanted.num_lost + wanted.num_received)
        ]

    def _subscribe(self, topic: str, kind: str, offers: list[QoSProfile]) -> None:
        present = self.recorded.get(topic)
        if present is not None and not any(qos.mismatch(offer, present.profile) for offer in offers):
            return
        profile = qos.adapted(offers, RECORDER_QUEUE)
        try:
            message_type = message_class(kind)
            self.bag.add_topic(topic, kind, profile)
        except ValueError as error:
            self.log.error(f"{topic}: cannot be recorded: {error}", every=60.0)
            return
        if present is not None:
            self.remove_subscription(present)
        write = partial(self._write, topic)
        wanted = self.add_subscription(topic, message_type, write, profile, is_required=False, raw=True)
        if present is not None:
            wanted.num_received, wanted.num_lost = present.num_received, present.num_lost
        self.recorded[topic] = wanted
        self.log.info(f"{topic}: recording")

    def _write(self, topic: str, data: bytes) -> None:
        self._attempt(lambda: self.bag.write_bytes(topic, data, self.now_ns()))

    def _attempt(self, step: Callable[[], None]) -> None:
        try:
            step()
        except OSError as error:  # the disk is full, or gone
            self.log.error(f"{self.bag.partial}: cannot be written: {error.strerror}", every=60.0)
            self.endpoints.finish(1)


def belongs(topic: str, kind: str, chosen: str) -> bool:
    """Return whether a topic of a type is in the set `chosen`; hidden topics (/_name) are in none."""
    if any(part.startswith("_") for part in topic.split("/")):
        return False
    return chosen == ALL or (chosen == "raw" and kind in SENSORS)


def main() -> int:
    """Run the node."""
    return run(BagRecorder)
