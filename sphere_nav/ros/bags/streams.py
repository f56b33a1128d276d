"""What the topics of anybody's bag hold: type, frame, size and encoding, as the first messages of each show them.

What cannot be used, whatever its type, has a `problem` that says why.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from weakref import WeakKeyDictionary

from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.recorded import TopicInfo
from sphere_nav.ros.bags.samples import COMPRESSED, IMAGE, NUM_SAMPLES, WITH_FRAME, Shown, examine_samples, is_depth

TRANSPORTS = ("/compressed", "/compressedDepth")

_READ: WeakKeyDictionary[BagReader, list[Stream]] = WeakKeyDictionary()  # of the bags that are open


@dataclass(frozen=True)
class Stream:
    """One topic of a bag, as its first messages show it; sizes are 0 and words empty where they do not say."""

    topic: str
    type: str
    count: int
    rate_hz: float
    frame_id: str = ""
    width: int = 0
    height: int = 0
    encoding: str = ""  # of an image, "compressed: <format>" of a compressed one, or the lens of a CameraInfo
    problem: str = ""  # why none of its messages can be used, in one line
    is_projected: bool = False  # a CameraInfo whose P is that of a calibrated camera
    lead_ns: int = 0  # by which its stamps are at least ahead of the recorder's clock

    @property
    def is_depth(self) -> bool:
        """Whether the pixels are distances."""
        return self.is_image and is_depth(self.encoding, self.topic)

    @property
    def is_image(self) -> bool:
        """Whether it is an image of any transport."""
        return self.type in (IMAGE, COMPRESSED)

    @property
    def is_picture(self) -> bool:
        """Whether it is an image of grey levels or colours."""
        return self.is_image and not self.is_depth

    @property
    def is_gray(self) -> bool:
        """Whether it is known to be without colour."""
        return self.encoding.startswith(("mono", "8UC1"))

    @property
    def base(self) -> str:
        """The topic without the ending of its transport."""
        return next((self.topic.removesuffix(end) for end in TRANSPORTS if self.topic.endswith(end)), self.topic)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.width, self.height


def read_streams(bag: BagReader) -> list[Stream]:
    """Return what the bag offers, in the order of the names; BagError for a damaged bag."""
    if bag not in _READ:
        first, last = bag.time_range
        seconds = (last - first) * 1e-9
        _READ[bag] = [_stream(bag, info, seconds) for _, info in sorted(bag.topics.items()) if info.count]
    return _READ[bag]


def _stream(bag: BagReader, info: TopicInfo, seconds: float) -> Stream:
    rate = (info.count - 1) / seconds if seconds > 0 else 0.0
    shown = Shown()
    if info.type in WITH_FRAME:
        sampled = islice(bag.messages([info.name]), NUM_SAMPLES)
        shown = examine_samples([(item.stamp_ns, item.message) for item in sampled], info.type, info.name)
    return Stream(info.name, info.type, info.count, rate, **vars(shown))
