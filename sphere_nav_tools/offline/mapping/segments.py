"""A drive cut in segments that overlap, each mapped from the bag by itself; the cut depends on the drive alone.

The instant that a segment ends with is a key sphere of it and of the next one, which joins the two. A segment begins a
few instants before, so that the motion is known by then; what it maps of those is left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.conversions import stamp_ns
from sphere_nav_tools.offline.constants import LEAD_NS, OFFLINE_DEADLINE_S, SEGMENT, WARM_UP

END_NS = (1 << 63) - 1
TAIL_NS = round(OFFLINE_DEADLINE_S * 1e9)  # that a message of an instant may be recorded later


@dataclass(frozen=True)
class DriveSegment:
    """Instants of a drive by their stamps in ns.

    first_ns: that of the instant that it shares with the segment before. warm_ns: from which on it maps. last_ns: that
    of the instant that it shares with the next one. begin_ns, end_ns: when its messages were recorded, None: from the
    beginning, up to the end.
    """

    number: int = 0
    total: int = 1
    warm_ns: int = 0
    first_ns: int = 0
    last_ns: int = END_NS
    begin_ns: int | None = None
    end_ns: int | None = None

    @property
    def name(self) -> str:
        """What its files are called."""
        return f"segment_{self.number:04d}"

    @property
    def is_first(self) -> bool:
        """Whether the map begins with it."""
        return self.number == 0

    @property
    def is_last(self) -> bool:
        """Whether the drive ends with it."""
        return self.number == self.total - 1


def cut(bag: BagReader, topic: str) -> list[DriveSegment]:
    """Return the segments of a drive by the images, or spheres, on a topic: of like duration, about `SEGMENT` each."""
    count = bag.topics[topic].count
    total = 1 if bag.is_packed else number_of(count)
    begin, end = next(bag.raw([topic])).stamp_ns, bag.time_range[1]
    found = list(_instants(bag, topic, [begin + (end - begin) * number // total for number in range(1, total)]))
    if total == 1 or len(found) < total - 1 or any(a[1] >= b[1] for a, b in pairwise(found)):
        return [DriveSegment()]  # short, to be unpacked for each segment, or of stamps that go back
    warm = (2 * WARM_UP + 1) * (end - begin) // (2 * count)
    cuts = [(0, 0, None, None), *((stamp - warm, stamp, at - warm - LEAD_NS, at + TAIL_NS) for at, stamp in found)]
    return [
        DriveSegment(number, total, *this[:2], after[1], this[2], after[3])
        for number, (this, after) in enumerate(pairwise([*cuts, (0, END_NS, None, None)]))
    ]


def number_of(count: int) -> int:
    """Return in how many segments so many instants are cut: from four on, so many that 2 or 4 workers end together."""
    number = max(round(count / SEGMENT), 1)
    return number if number < 3 else 4 * round(number / 4)


def _instants(bag: BagReader, topic: str, starts_ns: Iterable[int]) -> Iterator[tuple[int, int]]:
    """Yield when the first message from each of some times of recording on was recorded, and its stamp."""
    for start_ns in starts_ns:
        for _, at, message in bag.messages([topic], start_ns=start_ns):
            yield at, stamp_ns(message)
            break
