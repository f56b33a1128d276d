"""Which topics of anybody's bag a job reads, and why: named by the user or us, else the only ones that fit.

`TopicFinder` answers all commands alike, by the table of `topics`. What cannot be used is never found, but told with
its reason.
"""

from __future__ import annotations

import argparse
import logging
import os.path
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import islice, product
from typing import Any, TypeVar

import numpy as np

from sphere_mapping.ros.intake import TOPICS
from sphere_mapping.ros.stereo_intake import open_pair
from sphere_nav.geometry.arrays import Size
from sphere_nav.geometry.files.untrusted import told_at
from sphere_nav.geometry.plausible import check_mounting
from sphere_nav.params import meant
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.streams import (
    CAMERA_INFO,
    IMAGE,
    NUM_SAMPLES,
    SPHERE,
    SPHERE_INFO,
    VIDEO,
    Stream,
    read_streams,
)
from sphere_nav.ros.bags.writer import absolute
from sphere_nav.ros.camera.drivers import INPUTS, Driver, driver_names, read_driver
from sphere_nav.ros.conversions import is_rectified_topic, stamp_ns
from sphere_nav.ros.tf import TransformError, TransformTree
from sphere_nav_tools.offline.constants import NUM_PAIRED, NUM_TF_MESSAGES, SLACK_S
from sphere_nav_tools.offline.topics import BASE_FRAME, DEPTH, camera_names, role_of

ALONE = "one camera alone cannot map: add depth, a second camera beside it, or a rig; it can localise in a map"
CAMERAS = "cameras"  # images of a rig, which the stitcher makes spheres of
CAMERA_IS_VEHICLE = "0,0,0,0,0,0"  # a mounting
SIDES = (("left", "right"), ("infra1", "infra2"), ("cam0", "cam1"))
INFRARED = {"ir", "infra", "infra1", "infra2"}  # names of cameras whose light a projector makes
RGBD, STEREO = ("image_raw", DEPTH), ("left/image_raw", "right/image_raw")  # images that are chosen together
T = TypeVar("T")
Candidate = tuple[Stream, ...]
Preference = tuple[str, Callable[[Sequence[Candidate], Candidate], float]]  # a word; rank among all of one
KINDS = {
    "cameras": CAMERAS,
    "left": "stereo",
    "right": "stereo",
    "depth": "rgbd",
    "sphere": "sphere",
}  # by a name of ours


@dataclass(frozen=True)
class Choice:
    """The bag's topic for each of ours, and how they were told from others."""

    topics: dict[str, str]
    reason: str = ""


class TopicFinder:
    """What an open bag offers; `chosen` are the topics that the user named, by ours, `mounting` is his, too."""

    def __init__(self, bag: BagReader, chosen: Mapping[str, str] | None = None, mounting: str = "") -> None:
        self.bag, self.chosen, self.mounting = bag, dict(chosen or {}), mounting
        self.named = frozenset(self.chosen)  # by the user, whom no driver knows better

    @classmethod
    def of(cls, bag: BagReader, arguments: argparse.Namespace) -> TopicFinder:
        """Take what the user named, and what the driver that he named calls the rest."""
        finder = cls(bag, arguments.topics, arguments.mounting)
        if arguments.driver:
            finder.chosen = finder.of_driver(arguments.driver) | finder.chosen
        for line in finder.shared_frames():
            logging.getLogger("sphere_nav.frames").warning(line)
        return finder

    @cached_property
    def streams(self) -> Sequence[Stream]:
        """What there is, in the order of the names."""
        return [self._mounted(stream) for stream in read_streams(self.bag)]

    @cached_property
    def by_name(self) -> dict[str, Stream]:
        """The same by topic."""
        return {stream.topic: stream for stream in self.streams}

    @cached_property
    def usable(self) -> list[Stream]:
        """Those that can be used, without the compressed copy of a raw topic."""
        raw_last = sorted(self.streams, key=lambda stream: stream.type == IMAGE)
        best = {(stream.base, stream.is_depth): stream for stream in raw_last if not stream.problem}
        return sorted(best.values(), key=lambda stream: stream.topic)

    @cached_property
    def frames(self) -> TransformTree:
        """The frames: those that stand still, and as the first moving ones are."""
        return self.frames_told[0]

    @cached_property
    def frames_told(self) -> tuple[TransformTree, list[str]]:
        """The frames, and where those that stand still contradict each other, a line each."""
        tree, lines = TransformTree(), list[str]()
        for ours, is_static in (("tf_static", True), ("tf", False)):
            topic = absolute(self.chosen.get(ours, ours))
            found = self.bag.messages([topic]) if topic in self.bag.topics else ()
            for _, _, message in islice(found, NUM_TF_MESSAGES):
                for transform in message.transforms:
                    try:
                        line = tree.add(transform, is_static=is_static)
                    except ValueError as error:
                        line = str(error)
                    lines += [f"{topic}: {line}"] if line and is_static else []
        return tree, [*dict.fromkeys(lines)]

    def shared_frames(self) -> list[str]:
        """Return a line for each frame in which several cameras are, by topics that no driver has for one of them.

        Pictures beside a calibration of their own are those of a camera; both of a stereo pair may be in one frame.
        """
        roots = tuple(f"/{driver.root}/" for driver in self.drivers())
        calibrated = {(_folder(s), s.frame_id) for s in self.streams if s.type == CAMERA_INFO and s.frame_id}
        cameras: dict[str, dict[str, Stream]] = {}
        for stream in (s for s in self.usable if s.is_picture):
            if not stream.topic.startswith(roots) and (_folder(stream), stream.frame_id) in calibrated:
                cameras.setdefault(stream.frame_id, {}).setdefault(_folder(stream), stream)
        lefts = {frame: [s.topic for s in _without_rights([*found.values()])] for frame, found in cameras.items()}
        expected = "expected one camera, found {}: each needs a frame_id of its own"
        return [f"frame {name}: {expected.format(' and '.join(found))}" for name, found in lefts.items() if found[1:]]

    @property
    def lens(self) -> str:
        """What tells the lens of a single camera: its camera_info, or the sphere_info of a panorama."""
        is_panorama = any(stream.type == SPHERE_INFO for stream in self.streams) and "camera_info" not in self.chosen
        return "sphere_info" if is_panorama else "camera_info"

    @property
    def odometry(self) -> dict[str, str]:
        """Wheel or visual odometry, the one with most messages; nothing where there is none."""
        return self._beside("odom", lambda s: s.topic == "/odom", lambda s: s.count)

    @property
    def imu(self) -> dict[str, str]:
        """The IMU, one that /tf has on the vehicle before others; nothing where there is none."""
        on_vehicle = partial(self.frames.is_connected, BASE_FRAME)
        return self._beside("imu", lambda s: on_vehicle(s.frame_id), lambda s: "raw" not in s.topic)

    def refuse_unread(self, read: Iterable[str]) -> None:
        """Raise BagError for a topic of ours that the user named, and none of those that are read."""
        names = sorted({topic.removesuffix("/compressed").strip("/") for topic in read})
        for ours in sorted(self.named - set(names)):
            raise BagError(f"{ours}: expected one of {', '.join(names)}, found a topic that nobody reads here")

    def find(self, wanted: Sequence[str]) -> Choice:
        """Return the bag's topic for each of ours; BagError, with the reason, where it has not one for each."""
        with told_at(f"{self.bag.path}: topics", BagError):
            return self._find(wanted)

    def find_rig(self, names: Sequence[str]) -> Choice:
        """Return the images of those cameras of a rig file that the bag has; BagError where it has none."""
        images, named = ([f"cameras/{name}/image_raw" for name in some] for some in (names, camera_names(self.chosen)))
        return self.find([*dict.fromkeys([*filter(self.offered, images), *named])] or images)

    def find_localizer(self, settings: Mapping[str, Any]) -> Choice:
        """Return what a localiser with these parameters hears."""
        cameras = [f"cameras/{name}/" for name in camera_names(self.chosen)]
        images = [f"{camera}image_raw" for camera in cameras or ("",)]
        if settings.get("is_panorama") or (cameras and settings.get("rig.calibration")):
            return self.find(images)
        if cameras:
            return self.find(images + [f"{c}camera_info" for c in cameras if f"{c}sphere_info" not in self.chosen])
        return self.find(TOPICS["rgbd"] if settings.get("use_depth") else ("image_raw", self.lens))

    def find_source(self, settings: Mapping[str, Any] | None = None, *, has_rig: bool = False) -> tuple[str, Choice]:
        """Return what spheres are made of, a kind of TOPICS with its topics, or CAMERAS; BagError: nothing.

        What the user named decides, else our own names, else what is found; by calibrations, frames and stamps it must
        belong together, as far as no parameter of the mapper says more.
        """
        own = [] if self.chosen else [kind for kind in TOPICS if {*map(absolute, TOPICS[kind])} <= self.by_name.keys()]
        named = [KINDS[head] for head in map(_head, self.chosen) if head in KINDS]
        if has_rig or CAMERAS in named or (camera_names(s.base.strip("/") for s in self.streams) and not own):
            return CAMERAS, Choice({})
        has_spheres = any(stream.type == SPHERE for stream in self.streams)
        lacking, odd = list[str](), list[str]()  # why there are none; why those that there are cannot be used
        for kind in named or own or [kind for kind in TOPICS if (kind == "sphere") == has_spheres]:
            told = lacking
            try:
                choice, told = self._find(TOPICS[kind]), odd
                self.check_source(kind, choice.topics, settings or {})
                return kind, choice
            except ValueError as error:
                told.append(str(error))
        lacking += [ALONE] * (len(self.views(has_pairs=True)) == 1)
        raise BagError(f"{self.bag.path}: topics: {'; '.join(dict.fromkeys(odd or lacking))}")

    def drivers(self) -> list[Driver]:
        """Return the presets whose topics are all there under their usual names, those with registered depth first."""
        drivers = [read_driver(name) for name in driver_names()]
        found = [driver for driver in drivers if driver.root and not driver.missing(self.by_name)]
        return sorted(found, key=lambda d: (INPUTS.index(d.input), "depth/camera_info" in d.topics, d.name))

    def views(self, *, has_pairs: bool = False) -> list[Stream]:
        """Return one topic for each camera that sees the world's own light, the left one of a pair; or both of a pair.

        A driver tells a camera's images under several names: the one with colour counts, the first where all have it.
        """
        pictures = [stream for stream in self.usable if stream.is_picture]
        colored = _best(pictures, lambda picture: INFRARED.isdisjoint(picture.base.split("/")))
        best: dict[tuple[str, Size], Stream] = {}
        for view in sorted(colored if has_pairs else _without_rights(colored), key=lambda s: (s.is_gray, s.topic)):
            best.setdefault((view.frame_id or view.topic, view.size), view)
        return list(best.values())

    def slack_s(self, topic: str) -> float:
        """Return how far apart in s the stamps of one instant may be: a third of the period, as drivers jitter."""
        return float(np.clip(0.33 / max(self.by_name[absolute(topic)].rate_hz, 1e-3), *SLACK_S))

    def check_stamps(self, one: str, other: str, slack_s: float | None = None) -> None:
        """Raise BagError where no two images of two cameras are of one instant, as the beginning of the bag tells."""
        slack_s = self.slack_s(one) if slack_s is None else slack_s
        stamps: dict[str, list[int]] = {one: [], other: []}
        for topic, _, message in self.bag.messages(stamps):
            stamps[topic].append(stamp_ns(message))
            if min(map(len, stamps.values())) >= NUM_PAIRED:
                break
        apart_ns = np.abs(np.subtract.outer(*stamps.values()))
        nearest_ns = apart_ns.min(initial=np.iinfo(np.int64).max)
        if nearest_ns <= slack_s * 1e9:
            return
        expected = f"stamps within {1e3 * slack_s:.0f} ms of {one} (--set slack_s={slack_s:g})"
        raise BagError(f"{other}: expected {expected}, found {1e-6 * nearest_ns:.0f} ms at the nearest")

    def place_camera(self, found: Mapping[str, str], settings: Mapping[str, Any]) -> dict[str, str]:
        """Return the parameters `camera_frame` and `mounting` of a localiser; what is assumed is said.

        The frame is that of the images where their camera_info is of another, the mounting that of the user. Where
        nobody tells it, the camera is the vehicle.
        """
        odd, mounting = "", self.mounting
        image, info = (self.by_name[found[o]].frame_id if o in found else "" for o in ("image_raw", "camera_info"))
        if image and info and image != info:
            odd = image
            text = "camera_info is of frame %s, images are of frame %s: one camera by the names of the topics"
            logging.getLogger("sphere_nav.frames").warning(text, info, image)
        base, frame = str(settings.get("base_frame", BASE_FRAME)), str(settings.get("camera_frame") or image)
        if "image_raw" in found and base and not (mounting or self.frames.is_connected(base, frame)):
            mounting = CAMERA_IS_VEHICLE
            text = f"{BASE_FRAME}: not above the camera on /tf_static: the camera is taken as the vehicle"
            logging.getLogger("sphere_nav.mounting").warning("%s; --mounting tells otherwise", text)
        return {"camera_frame": odd, "mounting": mounting}

    def of_driver(self, name: str) -> dict[str, str]:
        """Return the topics of a driver, below the one namespace where the bag has them; BagError: none, or several."""
        driver, have = read_driver(name), list(self.by_name)
        roots, where = driver.roots(have), f"{self.bag.path}: driver {name}"
        if not roots:
            raise BagError(f"{where}: expected {', '.join(driver.missing(have))}, found {', '.join(have) or 'none'}")
        if len(roots) > 1:
            cameras = ", ".join(f"/{root}" for root in roots)
            raise BagError(f"{where}: expected one camera, found {cameras}: name topics (--image)")
        return driver.find(have, roots[0])

    def calibration_of(self, image: Stream, ours: str = "camera_info", known: str = "") -> Stream:
        """Return the CameraInfo of an image: the known one, else of its namespace, else of its frame and size.

        BagError where that is not one, is none, or is of another size; of a pair P may do for K.
        """
        infos = [stream for stream in self.streams if stream.type == CAMERA_INFO]
        near = [info for info in infos if info.topic == (known or f"{_folder(image)}/camera_info")] or infos
        fitting = [info for info in near if info.size == image.size or not (info.width and image.width)]
        fitting = _best(fitting, lambda info: info.frame_id == image.frame_id, lambda info: not info.problem)
        if len(fitting) != 1:
            found = ", ".join(f"{info.topic} ({info.width} x {info.height})" for info in fitting or near) or "none"
            expected = f"camera_info of {image.topic} ({image.width} x {image.height})"
            raise BagError(f"expected one topic with {expected}, found {found}; choose it by {role_of(ours).option}")
        (info,), is_pair = fitting, ours.startswith(("left", "right")) or is_rectified_topic(image.topic)
        if info.problem and not (is_pair and info.is_projected):
            raise BagError(f"{info.topic}: {info.problem}")
        return info

    def _mounted(self, stream: Stream) -> Stream:
        """Return a stream, of no use where the bag has its camera far from the vehicle, and the user nowhere."""
        try:
            if stream.is_picture and not (stream.problem or self.mounting):
                check_mounting(self.frames.lookup(BASE_FRAME, stream.frame_id).translation, stream.frame_id)
        except TransformError:
            return stream
        except ValueError as error:
            return replace(stream, problem=str(error))
        return stream

    def _find(self, wanted: Sequence[str]) -> Choice:
        found, reasons = self._given(wanted)
        for group in _groups(wanted):
            images, reason = self._choose(group, found)
            reasons += [reason]
            for ours, image in zip(group, images, strict=True):
                found[ours] = image.topic
                info = ours.removesuffix("image_raw") + "camera_info"
                if info in wanted or (ours == DEPTH and not _is_registered(images)):
                    found[info] = self.calibration_of(image, info, found.get(info, "")).topic
                elif "sphere_info" in wanted:
                    found = self._panorama(image) | found
        reason = ", ".join(dict.fromkeys(filter(None, reasons))) or "the only ones"
        return Choice({ours: found[ours] for ours in (*wanted, *found)}, reason)

    def check_source(self, kind: str, found: Mapping[str, str], settings: Mapping[str, Any]) -> None:
        """Raise ValueError for topics that do not belong together: two calibrations, frames, instants."""
        if "depth/camera_info" in found and not settings.get("depth_pose"):
            image, depth = (self.by_name[found[ours]].frame_id for ours in ("image_raw", "depth/camera_info"))
            if not self.frames.is_connected(image, depth):
                expected = f"expected {depth} and {image} on /tf_static"
                raise BagError(f"{expected}, found no way: record it, or registered depth")
        if kind == "stereo":
            infos = (found[f"{side}/camera_info"] for side in ("left", "right"))
            first = ([*islice(self.bag.messages([info]), NUM_SAMPLES)] for info in infos)
            left, right = (told[-1].message for told in first)  # a driver that begins may tell nothing yet
            open_pair(left, right, self.frames.lookup)
        if kind != "sphere":
            one, other = STEREO if kind == "stereo" else RGBD
            self.check_stamps(found[one], found[other], settings.get("slack_s"))

    def _given(self, wanted: Sequence[str]) -> tuple[dict[str, str], list[str]]:
        """Return what needs no search: what the user named, and our own names."""
        named = {ours: self._checked(ours, absolute(topic)) for ours, topic in self.chosen.items()}
        others = {*KINDS, "image_raw"} - {*map(_head, wanted)}  # what other sources begin with
        named = {ours: topic for ours, topic in named.items() if _head(ours) not in others}
        usable = {stream.topic for stream in self.streams if not _fault(stream)}
        own = {ours: absolute(ours) for ours in wanted if absolute(ours) in usable}
        return own | named, ["as named"] * bool(named) + ["by their names"] * (not own.keys() <= named.keys())

    def _checked(self, ours: str, topic: str) -> str:
        if topic not in self.by_name:
            hint = meant(topic, self.by_name)
            found = f"no such one{hint}" if hint else ", ".join(self.by_name) or "none"
            raise BagError(f"{ours}: expected topic {topic}, found {found}")
        stream, role = self.by_name[topic], role_of(ours)
        if _fault(stream):
            raise BagError(f"{ours}: {names_with_faults([stream])}")
        if role.types and stream.type not in role.types:
            raise BagError(f"{ours}: {topic}: expected {role.meaning}, found {stream.type}")
        return topic

    def _beside(self, ours: str, *ranks: Callable[[Stream], Any]) -> dict[str, str]:
        if ours in self.chosen:
            return {ours: absolute(self.chosen[ours])}
        found = _best(self.offered(ours), *ranks)
        return {ours: found[0].topic} if found else {}

    def _panorama(self, image: Stream) -> dict[str, str]:
        """Return the SphereInfo of an image: of its frame, and of its namespace."""
        frame, folder = image.frame_id, _folder(image)
        return self._beside("sphere_info", lambda s: s.frame_id == frame, lambda s: _folder(s) == folder)

    def offered(self, ours: str) -> list[Stream]:
        """Return the streams that can be what we call so."""
        if ours == "image_raw":
            return self.views()
        role = role_of(ours)
        return [stream for stream in self.usable if stream.type in role.types and role.fits(stream)]

    def _choose(self, group: tuple[str, ...], found: Mapping[str, str]) -> tuple[Candidate, str]:
        """Return the only streams for topics of ours that belong together, and what decided; BagError: not one."""
        pools = [[self.by_name[found[ours]]] if ours in found else self.offered(ours) for ours in group]
        is_free = group == STEREO and not found.keys() >= set(STEREO)
        candidates, decisive = [one for one in product(*pools) if not is_free or _is_pair(*one)], []
        for word, rank in _preferences(group):
            kept = _best(candidates, partial(rank, candidates))
            decisive += [word] * (len(kept) < len(candidates))
            candidates = kept
        if len(candidates) == 1:
            return candidates[0], ", ".join(decisive)
        lacking = [ours for ours, pool in zip(group, pools, strict=True) if not pool][:1] or group
        what = " with ".join(role_of(ours).meaning for ours in lacking)
        options = ", ".join(role_of(ours).option for ours in lacking)
        if not candidates:
            raise BagError(f"expected {what} ({options}), found {names_with_faults(self.streams)}")
        offered = "; ".join(" with ".join(stream.topic for stream in one) for one in candidates)
        raise BagError(f"expected one choice of {what}, found {len(candidates)}: {offered}; choose by {options}")


def names_of_cameras(views: Sequence[Stream]) -> list[str]:
    """Return a name for each of several cameras: the parts by which their topics differ."""
    parts = zip(*(view.base.strip("/").split("/") for view in views), strict=False)
    names = ["_".join(words) for words in zip(*(part for part in parts if len(set(part)) > 1), strict=True)]
    return names if len(set(names)) == len(views) else [f"camera{number}" for number in range(len(views))]


def _head(ours: str) -> str:
    return ours.split("/")[0]


def _groups(wanted: Sequence[str]) -> list[tuple[str, ...]]:
    """Return the images that are wanted, those together that must be of one device."""
    images = tuple(ours for ours in wanted if ours == "sphere" or ours.endswith("image_raw"))
    return [images] if images in (RGBD, STEREO) else [(image,) for image in images]


def _best(found: list[T], *ranks: Callable[[T], Any]) -> list[T]:
    """Leave what is first by a rank, of that what is first by the next one."""
    for rank in ranks:
        highest = max(map(rank, found), default=None)
        found = [one for one in found if rank(one) == highest]
    return found


def _is_registered(pair: Candidate) -> bool:
    """Whether depth is given for the very pixels of the image."""
    image, depth = pair
    has_size = depth.size == image.size or not (depth.width and image.width)
    return has_size and depth.frame_id == image.frame_id


def _is_pair(left: Stream, right: Stream) -> bool:
    """Whether the names are those of the left and the right side of one device."""
    return any(a in left.base and left.base.replace(a, b) == right.base for a, b in SIDES)


def _without_rights(pictures: Sequence[Stream]) -> list[Stream]:
    """Leave out the right side of a pair."""
    return [p for p in pictures if not any(_is_pair(other, p) for other in pictures)]


def _folder(stream: Stream) -> str:
    return stream.base.rpartition("/")[0]


def _nearness(pair: Candidate) -> float:
    """Return how near depth is to its image: registered to it, else how many parts their topics begin with alike."""
    return np.inf if _is_registered(pair) else os.path.commonpath([s.base for s in pair]).rstrip("/").count("/")


def _num_frames(candidate: Candidate) -> int:
    return min(stream.count for stream in candidate)


_OF_PAIRS: tuple[Preference, ...] = (
    ("more frames", lambda all_, one: 2 * _num_frames(one) > max(map(_num_frames, all_))),
    ("colour", lambda _, pair: not pair[0].is_gray),
)
# By what streams that could be chosen together are told apart, in this order; a word for each.
PREFERENCES: dict[tuple[str, ...], tuple[Preference, ...]] = {
    RGBD: (("depth of that camera", lambda _, pair: _nearness(pair)), *_OF_PAIRS),
    STEREO: (("rectified", lambda _, pair: "rect" in pair[0].base), *_OF_PAIRS),
}


def _preferences(group: tuple[str, ...]) -> tuple[Preference, ...]:
    """Return those of a group; of the camera of a rig, a topic that has its name for a part goes before others."""
    if not group[0].startswith("cameras/"):
        return PREFERENCES.get(group, ())
    name = group[0].split("/")[1]
    return (("its name", lambda _, one: name in one[0].base.split("/")),)


def names_with_faults(streams: Sequence[Stream]) -> str:
    """Return the topics; what is wrong with those that cannot be used goes before all that are something else."""
    faults = {stream.topic: _fault(stream) for stream in streams}
    return ", ".join([f"{topic} ({fault})" for topic, fault in faults.items() if fault] or faults) or "none"


def _fault(stream: Stream) -> str:
    """Return why a topic can be nobody's images: it is a video, or none of them can be used."""
    return f"video: {stream.type}" if stream.type in VIDEO else stream.problem * stream.is_image
