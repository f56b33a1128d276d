"""What the topics of anybody's bag are good for: found by type, name, frame, size and encoding, or told by the user.

Drivers call their topics as they like. `read_streams` looks at the first messages of each, `find_inputs` gives every
topic that a job of ours needs the bag's topic for it, and BagError, naming what there is, where that is not one choice.
What cannot be used, whatever its type, is never found: `problem` says why.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from weakref import WeakKeyDictionary

from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.recorded import BagError, TopicInfo
from sphere_nav.ros.bags.samples import (
    CAMERA_INFO,
    COMPRESSED,
    IMAGE,
    NUM_SAMPLES,
    ODOMETRY,
    SPHERE,
    VIDEO,
    WITH_FRAME,
    Shown,
    examine_samples,
    is_depth,
)
from sphere_nav.ros.bags.writer import absolute
from sphere_nav.ros.camera.odometry_input import TRUTH_WORDS

TRANSPORTS = ("/compressed", "/compressedDepth")
SIDES = (("left", "right"), ("infra1", "infra2"), ("cam0", "cam1"))
INFRARED = ("ir", "infra", "infra1", "infra2")  # names of cameras whose light a projector makes

RGBD = ("image_raw", "camera_info", "depth/image_raw")
STEREO = ("left/image_raw", "left/camera_info", "right/image_raw", "right/camera_info")

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


def find_inputs(
    streams: Sequence[Stream], wanted: Iterable[str], chosen: Mapping[str, str] | None = None
) -> dict[str, str]:
    """Return the bag's topic for each of ours in `wanted`; `chosen` are those that the user named.

    BagError, with the option to give, where nothing or no single topic fits.
    """
    by_name = {stream.topic: stream for stream in streams}
    found = {name: absolute(topic) for name, topic in (chosen or {}).items()}
    for name, topic in found.items():
        if topic not in by_name:
            near = difflib.get_close_matches(topic, by_name, n=1)
            found_there = f"no such one (is {near[0]} meant?)" if near else ", ".join(by_name) or "none"
            raise BagError(f"{name}: expected topic {topic}, found {found_there}")
        if not is_usable(by_name[topic]):
            raise BagError(f"{name}: {_names([by_name[topic]])}")
        if name.endswith("image_raw") and not by_name[topic].is_image:
            raise BagError(f"{name}: {topic}: expected images, found {by_name[topic].type}")
    wanted = tuple(wanted)
    found = {name: absolute(name) for name in wanted if is_usable(by_name.get(absolute(name)))} | found
    if "sphere" in wanted and "sphere" not in found:
        found["sphere"] = _only([s for s in streams if s.type == SPHERE], "spheres", "--remap sphere:=TOPIC").topic
    elif "depth/image_raw" in wanted:
        found = _find_rgbd(streams, found)
    elif "left/image_raw" in wanted:
        found = _find_stereo(streams, found)
    elif "image_raw" in wanted and "image_raw" not in found:
        broken = [stream for stream in streams if stream.is_image or stream.type in VIDEO]
        found["image_raw"] = _only(find_views(streams), "images (image_raw)", "--image", broken).topic
    if "camera_info" in wanted:
        image = by_name[found["image_raw"]]
        if "camera_info" in found:
            check_calibration(by_name[found["camera_info"]], image)
        else:
            found["camera_info"] = info_of(image, streams, "--info").topic
    return {name: found[name] for name in (*wanted, *(set(found) - set(wanted)))}


def find_odometry(streams: Sequence[Stream]) -> str:
    """Return the topic of wheel or visual odometry, the one with most messages; empty where there is none."""
    offered = [s for s in streams if s.type == ODOMETRY and not any(word in s.topic for word in TRUTH_WORDS)]
    offered = [s for s in offered if not s.problem]
    return max(offered, key=lambda s: (s.topic == "/odom", s.count)).topic if offered else ""


def info_of(image: Stream, streams: Sequence[Stream], option: str, *, is_pair: bool = False) -> Stream:
    """Return the CameraInfo of an image: of its namespace, else of its frame and size; `is_pair`: P may do for K."""
    infos = [s for s in streams if s.type == CAMERA_INFO]
    beside = image.base.rsplit("/", 1)[0] + "/camera_info"
    for info in infos:
        if info.topic == beside:
            check_calibration(info, image, is_pair=is_pair)
            return info
    fitting = [info for info in infos if info.size == image.size or not image.width]
    if infos and not fitting:
        sizes = ", ".join(f"{info.topic} ({info.width} x {info.height})" for info in infos)
        expected = f"camera_info of {image.topic} ({image.width} x {image.height})"
        raise BagError(f"topics: expected one topic with {expected}, found {sizes}; choose it by {option}")
    fitting = [i for i in fitting if i.frame_id == image.frame_id] or fitting
    info = _only([i for i in fitting if not i.problem] or fitting, f"camera_info of {image.topic}", option)
    check_calibration(info, image, is_pair=is_pair)
    return info


def check_calibration(info: Stream, image: Stream, *, is_pair: bool = False) -> None:
    """Raise BagError where a calibration is none, or is that of images of another size."""
    if info.type == CAMERA_INFO and info.problem and not (is_pair and info.is_projected):
        raise BagError(f"topics: {info.topic}: {info.problem}")
    if image.width and info.width and info.size != image.size:
        sizes = f"expected {info.width} x {info.height} ({info.topic}), found {image.width} x {image.height}"
        raise BagError(f"topics: {image.topic}: image size: {sizes}")


def is_registered(depth: Stream, image: Stream) -> bool:
    """Whether depth is given for the very pixels of the image."""
    has_size = depth.size == image.size or not (depth.width and image.width)
    return has_size and depth.frame_id == image.frame_id


def find_rig(streams: Sequence[Stream], names: Sequence[str]) -> dict[str, str]:
    """Return the topic of each camera of a rig by its name: the part of the topic that is, or ends in, the name."""
    found = {}
    for name in names:
        fitting = [s for s in _pictures(streams) if any(part == name for part in s.base.split("/"))]
        if not fitting:
            fitting = [s for s in _pictures(streams) if name in s.base.replace("_", "/").split("/")]
        if fitting:
            found[name] = _only(fitting, f"images of camera {name}", f"--camera {name}=TOPIC").topic
    return found


def _find_rgbd(streams: Sequence[Stream], found: dict[str, str]) -> dict[str, str]:
    """Prefer depth that is registered to the image, then the image with most frames."""
    by_name = {stream.topic: stream for stream in streams}
    images = [by_name[found["image_raw"]]] if "image_raw" in found else find_views(streams)
    depths = (
        [by_name[found["depth/image_raw"]]]
        if "depth/image_raw" in found
        else _without_twins(s for s in streams if s.is_depth and not s.problem)
    )
    pairs = [(image, depth) for image in images for depth in depths]
    if not pairs:
        missing = "images" if not images else "depth images"
        raise BagError(
            f"topics: expected {missing} ({'--image' if not images else '--depth'}), found {_names(streams)}"
        )
    registered = [pair for pair in pairs if is_registered(pair[1], pair[0])]
    image, depth = _only_pair(registered or _by_namespace(pairs))
    found = found | {"image_raw": image.topic, "depth/image_raw": depth.topic}
    if not registered and "depth/camera_info" not in found:
        found["depth/camera_info"] = info_of(depth, streams, "--depth-info").topic
    return found


def _find_stereo(streams: Sequence[Stream], found: dict[str, str]) -> dict[str, str]:
    pictures = {stream.base: stream for stream in _pictures(streams)}
    by_name = {stream.topic: stream for stream in streams}
    if "left/image_raw" in found and "right/image_raw" in found:
        pairs = [(by_name[found["left/image_raw"]], by_name[found["right/image_raw"]])]
    else:
        pairs = [
            (left, pictures[base.replace(a, b)])
            for base, left in pictures.items()
            for a, b in SIDES
            if a in base and base.replace(a, b) in pictures and base.replace(a, b) != base
        ]
    rectified = [pair for pair in pairs if "rect" in pair[0].base]
    if not pairs:
        raise BagError(f"topics: expected a left and a right camera (--left, --right), found {_names(streams)}")
    left, right = _only_pair(rectified or pairs, "--left, --right")
    found = found | {"left/image_raw": left.topic, "right/image_raw": right.topic}
    for side, image in (("left", left), ("right", right)):
        if f"{side}/camera_info" in found:
            check_calibration(by_name[found[f"{side}/camera_info"]], image, is_pair=True)
        else:
            found[f"{side}/camera_info"] = info_of(image, streams, f"--{side}-info", is_pair=True).topic
    return found


def _pictures(streams: Iterable[Stream]) -> list[Stream]:
    return _without_twins(stream for stream in streams if stream.is_picture and not stream.problem)


def find_views(streams: Sequence[Stream], *, has_pairs: bool = False) -> list[Stream]:
    """Return one topic for each camera that sees the world's own light, the left one of a pair; or both of a pair.

    A driver tells a camera's images under several names: the one with colour counts, the first where all have it.
    """
    pictures = _pictures(streams)
    bases = {picture.base for picture in pictures}
    colored = [p for p in pictures if not set(p.base.split("/")) & set(INFRARED)] or pictures
    lefts = [p for p in colored if not any(b in p.base and p.base.replace(b, a) in bases for a, b in SIDES)]
    seen = colored if has_pairs else lefts or colored
    best: dict[tuple[str, tuple[int, int]], Stream] = {}
    for view in sorted(seen, key=lambda stream: (stream.is_gray, stream.topic)):
        best.setdefault((view.frame_id or view.topic, view.size), view)
    return list(best.values())


def _without_twins(streams: Iterable[Stream]) -> list[Stream]:
    """Leave out the compressed copy of a raw topic."""
    best: dict[str, Stream] = {}
    for stream in streams:
        known = best.get(stream.base)
        if known is None or (stream.type == IMAGE and known.type != IMAGE):
            best[stream.base] = stream
    return list(best.values())


def _by_namespace(pairs: Sequence[tuple[Stream, Stream]]) -> list[tuple[Stream, Stream]]:
    """Keep the pairs whose topics begin alike for the longest: one device."""

    def shared(pair: tuple[Stream, Stream]) -> int:
        parts = [stream.base.split("/") for stream in pair]
        return next((i for i, (a, b) in enumerate(zip(*parts, strict=False)) if a != b), min(map(len, parts)))

    longest = max(map(shared, pairs))
    return [pair for pair in pairs if shared(pair) == longest]


def _only_pair(pairs: Sequence[tuple[Stream, Stream]], options: str = "--image, --depth") -> tuple[Stream, Stream]:
    most = max(min(a.count, b.count) for a, b in pairs)
    left = [(a, b) for a, b in pairs if 2 * min(a.count, b.count) > most]
    color = [(a, b) for a, b in left if not a.is_gray]
    left = color or left
    if len(left) > 1:
        offered = "; ".join(f"{a.topic} with {b.topic}" for a, b in left)
        raise BagError(f"topics: expected one pair of images, found {len(left)}: {offered}; choose by {options}")
    return left[0]


def _only(streams: Sequence[Stream], what: str, option: str, broken: Sequence[Stream] = ()) -> Stream:
    if len(streams) != 1:
        found = _names(streams or broken)
        raise BagError(f"topics: expected one topic with {what}, found {found}; choose it by {option}")
    return streams[0]


def _names(streams: Iterable[Stream]) -> str:
    """Return the topics; what is wrong with those that cannot be used goes before all that are something else."""
    streams = list(streams)
    broken = [f"{stream.topic} ({stream.problem})" for stream in streams if stream.problem and stream.is_image]
    broken += [f"{stream.topic} (video: {stream.type})" for stream in streams if stream.type in VIDEO]
    return ", ".join(broken or [stream.topic for stream in streams]) or "none"


def is_usable(stream: Stream | None) -> bool:
    """Whether there is a topic that is neither a video nor images of no use."""
    return stream is not None and stream.type not in VIDEO and not (stream.problem and stream.is_image)


def _stream(bag: BagReader, info: TopicInfo, seconds: float) -> Stream:
    rate = (info.count - 1) / seconds if seconds > 0 else 0.0
    shown = Shown()
    if info.type in WITH_FRAME:
        sampled = islice(bag.messages([info.name]), NUM_SAMPLES)
        shown = examine_samples([(item.stamp_ns, item.message) for item in sampled], info.type, info.name)
    return Stream(info.name, info.type, info.count, rate, **vars(shown))
