"""What can be done with a recording of anybody's: for each job the command to type, or what is missing.

A command is offered only where its inputs have been found as the command itself finds them, read by the conversions of
its nodes, and seen to belong together: sizes, calibrations, frames, stamps.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sphere_mapping.ros.stereo_intake import open_pair
from sphere_nav.geometry.files.rig_file import read_rig
from sphere_nav.localization.params import RigParams
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.samples import CAMERA_INFO, CLOUD, SPHERE
from sphere_nav.ros.bags.streams import RGBD, STEREO, Stream, find_odometry, find_views, info_of, read_streams
from sphere_nav.ros.camera.odometry_input import odometry_edge
from sphere_nav.ros.maps.writer import MAP_FRAME
from sphere_nav.ros.tf import TransformTree
from sphere_nav_tools.offline import topics

MIN_RIG_CAMERAS = 3
MAP, CLOUD_FILE, RIG_FILE = "MAP", "CLOUD", "rig.yaml"  # words of a command that stand for what the user has


@dataclass
class Offer:
    """What a bag does for one job."""

    job: str
    command: list[str] = field(default_factory=list)  # empty: it does not
    missing: str = ""
    note: str = ""


@dataclass(frozen=True, eq=False)
class OpenedBag:
    """An open bag and what has been found in it.

    `chosen` are the topics that the user named, by ours; `rig` his rig file, `mounting` where he says the camera sits.
    """

    bag: BagReader
    streams: Sequence[Stream]
    frames: TransformTree
    chosen: dict[str, str]
    rig: Path | None = None
    mounting: str = ""

    @classmethod
    def of(cls, bag: BagReader, chosen: dict[str, str], rig: Path | None = None, mounting: str = "") -> OpenedBag:
        """Look at the topics and the frames of a bag."""
        return cls(bag, read_streams(bag), topics.read_frames(bag), chosen, rig, mounting)

    @property
    def odometry(self) -> str:
        """Where odometry comes from: a topic, two frames of /tf, or nowhere (empty)."""
        edge = odometry_edge(self.frames, topics.BASE_FRAME, MAP_FRAME)
        return find_odometry(self.streams) or (f"{topics.TF_TOPIC} ({edge[0]} to {edge[1]})" if edge else "")

    def first(self, topic: str) -> Any:
        """Return the first message of a topic."""
        return next(self.bag.messages([topic])).message

    def frame_of(self, topic: str) -> str:
        """Return the frame of the messages of a topic."""
        return next(stream.frame_id for stream in self.streams if stream.topic == topic)

    def find(self, wanted: Sequence[str]) -> dict[str, str]:
        """Return the topics that a job wants, by ours; BagError where there are none, or several."""
        words = {topic.split("/")[0] for topic in wanted} | {"camera_info", "odom", "imu"}
        chosen = {ours: topic for ours, topic in self.chosen.items() if ours.split("/")[0] in words}
        return topics.find_wanted(self.streams, wanted, chosen)

    def check_stamps(self, one: str, other: str) -> None:
        """Raise BagError where no two images of two cameras are of one instant."""
        slack_s, found_s = topics.pairing_slack(self.bag, one), topics.nearest_pair_s(self.bag, one, other)
        if found_s > slack_s:
            expected = f"stamps within {1e3 * slack_s:.0f} ms of {one} (--set slack_s={slack_s:g})"
            raise BagError(f"{other}: expected {expected}, found {1e3 * found_s:.0f} ms at the nearest")


def find_offers(recording: OpenedBag) -> list[Offer]:
    """Return what can be done with a bag: map, localise, mcl."""
    return [offer_map(recording), offer_localize(recording), offer_mcl(recording)]


def offer_map(recording: OpenedBag) -> Offer:
    """Return how to map: from spheres, colour and depth, a stereo pair, or the cameras of a rig."""
    streams, bag = recording.streams, recording.bag
    command = ["sphere_nav", "map", str(bag.path), "-o", f"{bag.path.stem}_map"]
    if any(stream.type == SPHERE for stream in streams):
        return Offer("map", command + topics.options_of(recording.find(("sphere",))), note="from spheres")
    reasons = []
    kinds = (RGBD, "from colour and depth", check_depth_topics), (STEREO, "from a stereo pair", check_pair)
    for wanted, note, check in kinds:
        try:
            found = recording.find(wanted)
            check(recording, found)
        except ValueError as error:
            reasons.append(str(error).removeprefix("topics: "))
            continue
        if "depth/camera_info" in found:
            note += ", depth registered to the images by both calibrations and /tf_static"
        return Offer("map", command + topics.options_of(found), note=note)
    has_depth = any(stream.is_depth and not stream.problem for stream in streams)
    if recording.rig or (not has_depth and len(find_views(streams, has_pairs=True)) >= MIN_RIG_CAMERAS):
        return _offer_rig(recording, command)
    return Offer("map", missing="; ".join(dict.fromkeys(reasons)))


def check_depth_topics(recording: OpenedBag, found: dict[str, str]) -> None:
    """Raise BagError for depth that cannot be registered to the images, or is of other instants."""
    if "depth/camera_info" in found:
        by_name = {stream.topic: stream for stream in recording.streams}
        image, depth = by_name[found["image_raw"]].frame_id, by_name[found["depth/camera_info"]].frame_id
        if not recording.frames.is_connected(image, depth):
            raise BagError(f"expected {depth} and {image} on /tf_static, found no way: record it, or registered depth")
    recording.check_stamps(found["image_raw"], found["depth/image_raw"])


def check_pair(recording: OpenedBag, found: dict[str, str]) -> None:
    """Raise ValueError for a pair whose calibrations tell no baseline, or that was not taken together."""
    left, right = (recording.first(found[f"{side}/camera_info"]) for side in ("left", "right"))
    open_pair(left, right, recording.frames.lookup)
    recording.check_stamps(found["left/image_raw"], found["right/image_raw"])


def _offer_rig(recording: OpenedBag, command: list[str]) -> Offer:
    """Return how to map by several cameras, named as in the rig file, or as their topics differ."""
    views = find_views(recording.streams, has_pairs=True)
    if recording.rig is None:
        names = topics.names_of_cameras(views)
        words = [f"--camera={name}={view.topic}" for name, view in zip(names, views, strict=True)]
        note = f"from the cameras of a rig, with {RIG_FILE} (sphere_nav calibrate, or rig-convert) that has these names"
        return Offer("map", [*command, "--rig", RIG_FILE, *words], note=note)
    try:
        names = list(read_rig(recording.rig).names)
        found = topics.find_rig_topics(recording.bag, names, recording.chosen)
    except BagError as error:
        return Offer("map", missing=str(error).removeprefix(f"{recording.bag.path}: topics: "))
    lacking = ", ".join(name for name in names if f"cameras/{name}/image_raw" not in found)
    note = "from the cameras of a rig" + (f", without {lacking}" if lacking else "")
    words = [f"--camera={ours.split('/')[1]}={topic}" for ours, topic in found.items() if ours.startswith("cameras/")]
    return Offer("map", [*command, "--rig", str(recording.rig), *words], note=note)


def offer_localize(recording: OpenedBag) -> Offer:
    """Return how to localise by one camera, or by several that sit on one vehicle."""
    bag, odometry = recording.bag, recording.odometry
    command = ["sphere_nav", "localize", MAP, str(bag.path), "-o", f"{bag.path.stem}.tum"]
    note = f"ready, with odometry of {odometry}" if odometry else ""
    try:
        words, is_sure = _camera_words(recording)
    except ValueError as error:
        views = find_views(recording.streams, has_pairs=True)
        if len(views) > 1 and not recording.chosen:
            with suppress(BagError):
                return _offer_cameras(recording, command, views)
        return Offer("localize", missing=str(error).removeprefix("topics: "))
    return Offer("localize", command + words, note=note if is_sure else PANORAMA_NOTE)


PANORAMA_NOTE = "ready, if the images, which have no camera_info, are whole spheres (equirectangular)"


def _camera_words(recording: OpenedBag) -> tuple[list[str], bool]:
    """Return the options that name camera and odometry, and whether the camera's lens is known for sure."""
    odometry = find_odometry(recording.streams)
    named = {"odom": odometry} if odometry else {}
    try:
        found = topics.find_lens_topics(recording.streams, recording.find)
    except BagError:
        found = recording.find(("image_raw",))
        image = next(stream for stream in recording.streams if stream.topic == found["image_raw"])
        has_info = any(stream.encoding and not stream.is_image for stream in recording.streams)
        if has_info or image.width != 2 * image.height or not image.width:
            raise
        return [*topics.options_of(named | found), "--set", "is_panorama=true"], False
    return topics.options_of(named | found), True


def _offer_cameras(recording: OpenedBag, command: list[str], views: Sequence[Stream]) -> Offer:
    """Return how to localise by all cameras: lenses and places by the bag, or of many without by the map of the rig.

    BagError where neither tells them.
    """
    names = topics.names_of_cameras(views)
    words = [f"--camera={name}={view.topic}" for name, view in zip(names, views, strict=True)]
    frames, infos = recording.frames, [stream for stream in recording.streams if not stream.is_image]
    if len(views) >= MIN_RIG_CAMERAS and not any(stream.type == CAMERA_INFO for stream in infos):
        note = f"ready, by {len(views)} cameras, in a map made by a rig with these names"
        command = [*command, "--set", "rig.calibration=map", *words]
        if not recording.mounting and not frames.is_connected(topics.BASE_FRAME, RigParams().frame):
            note += ", which is taken as the vehicle; --mounting tells otherwise"
            command += ["--mounting", topics.CAMERA_IS_VEHICLE]
        return Offer("localize", command, note=note)
    for view in views:
        info_of(view, infos, "--info")
        if not frames.is_connected(topics.BASE_FRAME, view.frame_id):
            raise BagError(f"expected {view.frame_id} on /tf_static, found no way to it")
    return Offer("localize", command + words, note=f"ready, by {len(views)} cameras")


def offer_mcl(recording: OpenedBag) -> Offer:
    """Return how to localise in bare geometry."""
    bag = recording.bag
    try:
        words, is_sure = _camera_words(recording)
    except ValueError as error:
        return Offer("mcl", missing=str(error).removeprefix("topics: "))
    if not recording.odometry:
        expected = f"odometry (nav_msgs/Odometry, or a frame that moves above {topics.BASE_FRAME} on /tf)"
        return Offer("mcl", missing=f"expected {expected}, found none")
    frame = recording.frame_of(recording.find(("image_raw",))["image_raw"])
    if not recording.mounting and not recording.frames.is_connected(topics.BASE_FRAME, frame):
        expected = f"{topics.BASE_FRAME} and {frame or 'the images'} on /tf_static, or the height by --mounting"
        return Offer("mcl", missing=f"expected {expected}, found neither")
    clouds = ", ".join(stream.topic for stream in recording.streams if stream.type == CLOUD)
    note = f"ready; the bag has point clouds, too ({clouds})" if clouds else ""
    command = ["sphere_nav", "mcl", CLOUD_FILE, str(bag.path), "-o", f"{bag.path.stem}_mcl.tum", *words]
    return Offer("mcl", command, note=note if is_sure else PANORAMA_NOTE)
