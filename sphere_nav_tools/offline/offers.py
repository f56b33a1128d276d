"""What can be done with a recording of anybody's: for each job the command to type, or what is missing.

A command is offered only where its inputs have been found as the command itself finds them, read by the conversions of
its nodes, and seen to belong together: sizes, calibrations, frames, stamps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sphere_mapping.ros.intake import TOPICS
from sphere_mapping.ros.stereo_intake import open_pair
from sphere_nav.geometry.files.rig_file import read_rig
from sphere_nav.localization.params import RigParams
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.streams import CAMERA_INFO, CLOUD, SPHERE, Stream
from sphere_nav.ros.camera.odometry_input import odometry_edge
from sphere_nav.ros.conversions import is_rectified_topic
from sphere_nav.ros.maps.writer import MAP_FRAME
from sphere_nav_tools.offline.topic_finder import CAMERA_IS_VEHICLE, Choice, TopicFinder, names_of_cameras
from sphere_nav_tools.offline.topics import BASE_FRAME, TF_TOPIC, camera_names, options_of

MIN_RIG_CAMERAS = 3
MAP, CLOUD_FILE, RIG_FILE = "MAP", "CLOUD", "rig.yaml"  # words of a command that stand for what the user has


@dataclass
class Offer:
    """What a bag does for one job."""

    job: str
    command: list[str] = field(default_factory=list)  # empty: it does not
    missing: str = ""
    note: str = ""
    reason: str = ""  # by which the topics were told from others


@dataclass(frozen=True, eq=False)
class OpenedBag:
    """An open bag, the rig file of the user, and where he says the camera sits."""

    finder: TopicFinder
    rig: Path | None = None
    mounting: str = ""

    @property
    def path(self) -> Path:
        """Of the bag."""
        return self.finder.bag.path

    @property
    def odometry(self) -> str:
        """Where odometry comes from: a topic, two frames of /tf, or nowhere (empty)."""
        edge = odometry_edge(self.finder.frames, BASE_FRAME, MAP_FRAME)
        by_tf = f"{TF_TOPIC} ({edge[0]} to {edge[1]})" if edge else ""
        return self.finder.odometry.get("odom", by_tf)

    def first(self, topic: str) -> Any:
        """Return the first message of a topic."""
        return next(self.finder.bag.messages([topic])).message

    def check_stamps(self, one: str, other: str) -> None:
        """Raise BagError where no two images of two cameras are of one instant."""
        slack_s, found_s = self.finder.slack_s(one), self.finder.nearest_pair_s(one, other)
        if found_s > slack_s:
            expected = f"stamps within {1e3 * slack_s:.0f} ms of {one} (--set slack_s={slack_s:g})"
            raise BagError(f"{other}: expected {expected}, found {1e3 * found_s:.0f} ms at the nearest")


def find_offers(recording: OpenedBag) -> list[Offer]:
    """Return what can be done with a bag: map, localise, mcl."""
    return [offer_map(recording), offer_localize(recording), offer_mcl(recording)]


def offer_map(recording: OpenedBag) -> Offer:
    """Return how to map: from spheres, colour and depth, a stereo pair, or the cameras of a rig."""
    finder, reasons = recording.finder, []
    command = ["sphere_nav", "map", str(recording.path), "-o", f"{recording.path.stem}_map"]
    has_spheres = any(stream.type == SPHERE for stream in finder.streams)
    for kind, note, check in _SPHERES if has_spheres else _IMAGES:
        choice = finder.find(TOPICS[kind])
        reason = choice.reason
        if choice.topics:
            try:
                check(recording, choice.topics)
            except ValueError as error:
                reason = str(error)
            else:
                if "depth/camera_info" in choice.topics:
                    note += ", depth registered to the images by both calibrations and /tf_static"
                note += "; " * bool(_rectified(choice.topics)) + _rectified(choice.topics)
                return Offer("map", command + options_of(choice.topics), "", note, choice.reason)
        reasons.append(reason)
    has_depth = any(stream.is_depth and not stream.problem for stream in finder.streams)
    if recording.rig or (not has_depth and len(finder.views(has_pairs=True)) >= MIN_RIG_CAMERAS):
        return _offer_rig(recording, command)
    return Offer("map", missing="; ".join(dict.fromkeys([*reasons, *finder.alone])))


def check_depth_topics(recording: OpenedBag, found: dict[str, str]) -> None:
    """Raise BagError for depth that cannot be registered to the images, or is of other instants."""
    if "depth/camera_info" in found:
        by_name = recording.finder.by_name
        image, depth = by_name[found["image_raw"]].frame_id, by_name[found["depth/camera_info"]].frame_id
        if not recording.finder.frames.is_connected(image, depth):
            raise BagError(f"expected {depth} and {image} on /tf_static, found no way: record it, or registered depth")
    recording.check_stamps(found["image_raw"], found["depth/image_raw"])


def check_pair(recording: OpenedBag, found: dict[str, str]) -> None:
    """Raise ValueError for a pair whose calibrations tell no baseline, or that was not taken together."""
    left, right = (recording.first(found[f"{side}/camera_info"]) for side in ("left", "right"))
    open_pair(left, right, recording.finder.frames.lookup)
    recording.check_stamps(found["left/image_raw"], found["right/image_raw"])


_SPHERES = (("sphere", "from spheres", lambda *_: None),)
_IMAGES = (("rgbd", "from colour and depth", check_depth_topics), ("stereo", "from a stereo pair", check_pair))


def _offer_rig(recording: OpenedBag, command: list[str]) -> Offer:
    """Return how to map by several cameras, named as in the rig file, or as their topics differ."""
    if recording.rig is None:
        note = f"from the cameras of a rig, with {RIG_FILE} (sphere_nav calibrate, or rig-convert) that has these names"
        words = _named_views(recording.finder.views(has_pairs=True))
        return Offer("map", [*command, "--rig", RIG_FILE, *words], note=note)
    names = list(read_rig(recording.rig).names)
    choice = recording.finder.find_rig(names)
    if not choice.topics:
        return Offer("map", missing=choice.reason)
    found = {name: choice.topics[f"cameras/{name}/image_raw"] for name in camera_names(choice.topics)}
    lacking = ", ".join(name for name in names if name not in found)
    note = "from the cameras of a rig" + (f", without {lacking}" if lacking else "")
    words = [f"--camera={name}={topic}" for name, topic in found.items()]
    return Offer("map", [*command, "--rig", str(recording.rig), *words], note=note, reason=choice.reason)


def _rectified(topics: Mapping[str, str]) -> str:
    """Return what is done where images are rectified by their names, nothing where none is."""
    found = [name for ours, name in topics.items() if ours.endswith("image_raw") and is_rectified_topic(name)]
    return f"{', '.join(found)}: rectified, P of camera_info is used" if found else ""


NO_ODOMETRY = f"no place is trusted without odometry (nav_msgs/Odometry, or a frame above {BASE_FRAME} on /tf)"

PANORAMA_NOTE = "ready, if the images, which have no camera_info, are whole spheres (equirectangular)"


def offer_localize(recording: OpenedBag) -> Offer:
    """Return how to localise by one camera, or by several that sit on one vehicle."""
    finder, odometry = recording.finder, recording.odometry
    command = ["sphere_nav", "localize", MAP, str(recording.path), "-o", f"{recording.path.stem}.tum"]
    choice, more = _or_panorama(finder, finder.find_localizer({}))
    if choice.topics:
        note = PANORAMA_NOTE if more else f"ready, with odometry of {odometry}" * bool(odometry)
        note += _rectified(choice.topics) and ((note and "; ") or "ready; ") + _rectified(choice.topics)
        words = options_of(finder.odometry | choice.topics)
        return Offer("localize", [*command, *words, *more], note=note, reason=choice.reason)
    views = finder.views(has_pairs=True)
    if len(views) > 1 and not finder.chosen:
        with suppress(BagError):
            return _offer_cameras(recording, command, views)
    return Offer("localize", missing=choice.reason)


def _or_panorama(finder: TopicFinder, choice: Choice) -> tuple[Choice, list[str]]:
    """Return the images of a camera; where none is calibrated, those that may be whole spheres, and the option then."""
    if choice.topics or any(stream.encoding and not stream.is_image for stream in finder.streams):
        return choice, []
    whole = finder.find(["image_raw"])
    image = finder.by_name.get(whole.topics.get("image_raw", ""))
    is_panorama = image is not None and image.width == 2 * image.height and image.width > 0
    return (whole, ["--set", "is_panorama=true"]) if is_panorama else (choice, [])


def _named_views(views: Sequence[Stream]) -> list[str]:
    return [f"--camera={name}={view.topic}" for name, view in zip(names_of_cameras(views), views, strict=True)]


def _offer_cameras(recording: OpenedBag, command: list[str], views: Sequence[Stream]) -> Offer:
    """Return how to localise by all cameras: lenses and places by the bag, or of many without by the map of the rig.

    BagError where neither tells them.
    """
    words, frames = _named_views(views), recording.finder.frames
    if len(views) >= MIN_RIG_CAMERAS and not any(stream.type == CAMERA_INFO for stream in recording.finder.streams):
        note = f"ready, by {len(views)} cameras, in a map made by a rig with these names"
        command = [*command, "--set", "rig.calibration=map", *words]
        if not recording.mounting and not frames.is_connected(BASE_FRAME, RigParams().frame):
            note += ", which is taken as the vehicle; --mounting tells otherwise"
            command += ["--mounting", CAMERA_IS_VEHICLE]
        return Offer("localize", command, note=note)
    for view in views:
        recording.finder.calibration_of(view)
        if not frames.is_connected(BASE_FRAME, view.frame_id):
            raise BagError(f"expected {view.frame_id} on /tf_static, found no way to it")
    return Offer("localize", command + words, note=f"ready, by {len(views)} cameras")


def offer_mcl(recording: OpenedBag) -> Offer:
    """Return how to localise in bare geometry."""
    finder = recording.finder
    choice, more = _or_panorama(finder, finder.find(("image_raw", finder.lens)))
    if not choice.topics:
        return Offer("mcl", missing=choice.reason)
    frame = finder.by_name[choice.topics["image_raw"]].frame_id
    if not recording.mounting and not finder.frames.is_connected(BASE_FRAME, frame):
        expected = f"{BASE_FRAME} and {frame or 'the images'} on /tf_static, or the height by --mounting"
        return Offer("mcl", missing=f"expected {expected}, found neither")
    clouds = ", ".join(stream.topic for stream in finder.streams if stream.type == CLOUD)
    notes = [f"the bag has point clouds, too ({clouds})"] * bool(clouds) + [NO_ODOMETRY] * (not recording.odometry)
    note = "; ".join(["ready", *notes]) if notes else ""
    command = ["sphere_nav", "mcl", CLOUD_FILE, str(recording.path), "-o", f"{recording.path.stem}_mcl.tum"]
    words = options_of(finder.odometry | choice.topics)
    return Offer("mcl", [*command, *words, *more], note=PANORAMA_NOTE if more else note, reason=choice.reason)
