"""Where a player is in its bag, and which message is due: no ROS beneath it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence

from sphere_nav.ros import qos
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.recorded import Recorded, TopicInfo

Clock = Callable[[], float]


class Playback:
    """Messages of a bag from `start_ns` on, each due when its time has come; rate 0: at once."""

    def __init__(
        self, bag: BagReader, topics: Sequence[str], start_ns: int, rate: float, clock: Clock = time.monotonic
    ) -> None:
        self.total = sum(bag.topics[name].count for name in topics)
        self._bag, self._topics, self._start_ns, self._rate, self._clock = bag, list(topics), start_ns, rate, clock
        self._latched = {name for name in topics if is_latched(bag.topics[name])}
        self.done = 0
        self._stream = self._from_start()
        self.next: Recorded | None = next(self._stream, None)
        self._origin: tuple[float, int] | None = None  # wall time and stamp that belong together

    def latched(self) -> Iterator[Recorded]:
        """Yield the messages of latched topics up to the start: they hold from then on."""
        if self._latched:
            yield from self._bag.raw(self._latched, end_ns=self._start_ns)

    def pause(self) -> None:
        """Let no time pass until the next call of `take`."""
        self._origin = None

    def take(self) -> Recorded | None:
        """Return the next message if it is due, and go on to the one after it."""
        item = self.next
        if item is not None and self._origin is None:
            self._origin = (self._clock(), item.stamp_ns)
        if item is None or (self._rate and item.stamp_ns > self._wall_ns()):
            return None
        self.done, self.next = self.done + 1, next(self._stream, None)
        return item

    def present_ns(self) -> int:
        """Return the time in the bag, never beyond the next message; 0 after the last one."""
        if self.next is None:
            return 0
        is_running = self._origin is not None and self._rate > 0
        return min(self._wall_ns(), self.next.stamp_ns) if is_running else self.next.stamp_ns

    def _wall_ns(self) -> int:
        assert self._origin is not None
        return self._origin[1] + round((self._clock() - self._origin[0]) * self._rate * 1e9)

    def _from_start(self) -> Iterator[Recorded]:
        for item in self._bag.raw(self._topics, self._start_ns):
            if item.topic not in self._latched or item.stamp_ns > self._start_ns:
                yield item


def is_latched(info: TopicInfo) -> bool:
    """Return whether a topic was offered as transient local."""
    return any(profile.durability == qos.TRANSIENT_LOCAL for profile in info.profiles)
