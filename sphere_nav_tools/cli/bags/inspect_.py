"""`sphere_nav inspect`: what a recording of anybody's offers, what is missing for which job, and what to type.

A command is offered only where its inputs have been found as the command itself finds them, read by the conversions of
its nodes, and seen to belong together: sizes, calibrations, frames, stamps.
"""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path

from mcl_depth.constants import MIN_HEIGHT_M
from sphere_nav.geometry.files.rig_file import read_rig
from sphere_nav.localization.params import RigParams
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.recorded import BagError
from sphere_nav.ros.bags.streams import CAMERA_INFO, CLOUD, Stream
from sphere_nav.ros.camera.mounting import read_mounting
from sphere_nav.ros.camera.odometry_input import odometry_edge
from sphere_nav.ros.conversions import is_rectified_topic
from sphere_nav.ros.maps.writer import MAP_FRAME
from sphere_nav.ros.tf import TransformError, TransformTree
from sphere_nav_tools.offline.importing.images import how_to_import
from sphere_nav_tools.offline.settings import FileAction, add, add_overwrite
from sphere_nav_tools.offline.tables import columns, write_json
from sphere_nav_tools.offline.topic_finder import (
    CAMERA_IS_VEHICLE,
    CAMERAS,
    Choice,
    TopicFinder,
    names_of_cameras,
    names_with_faults,
)
from sphere_nav_tools.offline.topics import BASE_FRAME, DEPTH, TF_TOPIC, add_options, camera_names, options_of

MIN_RIG_CAMERAS = 3
MAP, CLOUD_FILE, RIG_FILE = "MAP", "CLOUD", "rig.yaml"  # words of a command that stand for what the user has
HELP = """\
Tell what a bag offers: its topics with type, rate, frame and size; then for mapping, localising and mcl what is
missing, or the command to type. Topics may have any names. MAP and CLOUD stand for a map and a file of geometry.

A video or a folder of images is no bag yet: the command that makes one is printed.

examples:
  sphere_nav inspect drive
  sphere_nav inspect walk_360.mp4
  sphere_nav inspect recording.mcap --json offer.json
  sphere_nav inspect six_cameras --rig rig.yaml
  sphere_nav inspect recording.db3 --driver zed --mounting 0.4,0,1.1,0,0,0
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "bag", "BAG", "a recording; or a video, or a folder of images", Path)
    add(parser, "--json", "F", "also write it as JSON", Path, action=FileAction)
    add_overwrite(parser)
    add(parser, "--rig", "F", "rig file of the cameras in the bag", Path)
    add_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print the topics and the offers; 1 if the bag is good for none of the jobs."""
    if words := how_to_import(arguments.bag):
        print("\n".join(words))
        return 0
    with BagReader(arguments.bag) as bag:
        finder = TopicFinder.of(bag, arguments)
        streams, (first, last) = finder.streams, bag.time_range
        mounting = describe_mountings(finder.frames, streams, arguments.mounting) + finder.frames_told[1]
        offers = [find_offer(job, finder, arguments.rig) for job in ("map", "localize", "mcl")]
    print(f"{arguments.bag}: {(last - first) * 1e-9:.1f} s, {sum(stream.count for stream in streams)} messages")
    print("\n".join(topic_table(streams)))
    drivers = [f"driver: {driver.title}: --driver {driver.name}" for driver in finder.drivers()]
    print("\n".join([*drivers, *mounting]))
    for offer in offers:
        print(f"\n{offer.job}: {(offer.note or 'ready') if offer.command else offer.missing}")
        if offer.command:
            print(f"  {shlex.join(offer.command)}")
        if offer.reason:
            print(f"  topics: {offer.reason}")
    if arguments.json:
        content = {"topics": [asdict(stream) for stream in streams], "jobs": [asdict(offer) for offer in offers]}
        write_json(arguments.json, content)
    return 0 if any(offer.command for offer in offers) else 1


def describe_mountings(frames: TransformTree, streams: Sequence[Stream], given: str) -> list[str]:
    """Return for each camera whether it is known where it sits on the vehicle; ValueError for a wrong mounting."""
    if read_mounting(given) is not None:
        return [f"mounting: {given}, for {BASE_FRAME} and the camera"]
    lines = []
    for frame in dict.fromkeys(stream.frame_id for stream in streams if stream.is_picture and stream.frame_id):
        try:
            x, y, z = frames.lookup(BASE_FRAME, frame).translation
        except TransformError:
            lines.append(f"mounting: {frame}: not told by /tf_static: it is taken as the vehicle; else --mounting")
        else:
            lines.append(f"mounting: {frame}: x {x:.3f}, y {y:.3f}, z {z:.3f} m on {BASE_FRAME} by /tf_static")
    return lines


def topic_table(streams: Sequence[Stream]) -> list[str]:
    """Return a line for each topic."""
    rows: list[tuple[str | int, ...]] = [("topic", "type", "messages", "rate", "frame", "content")]
    for s in streams:
        size = f"{s.width} x {s.height} " if s.width else ""
        rate = f"{s.rate_hz:.1f} Hz" if s.count > 1 else ""
        content = f"{size}{s.encoding}".strip() + f" (of no use: {s.problem})" * bool(s.problem)
        rows.append((s.topic, s.type.split("/")[-1], s.count, rate, s.frame_id, content.strip()))
    return columns(rows)


@dataclass
class Offer:
    """What a bag does for one job."""

    job: str
    command: list[str] = field(default_factory=list)  # empty: it does not
    missing: str = ""
    note: str = ""
    reason: str = ""  # by which the topics were told from others


def find_offer(job: str, finder: TopicFinder, rig: Path | None = None) -> Offer:
    """Return what a bag does for a job: map (with the rig file of its cameras), localize, mcl."""
    (given, ending, find), bag = JOBS[job], finder.bag.path
    try:
        words, note, reason = find(finder, rig)
    except BagError as error:
        return Offer(job, missing=str(error).removeprefix(f"{bag}: topics: "))
    words += ["--mounting", finder.mounting] if finder.mounting else []
    command = ["sphere_nav", job, *given, str(bag), "-o", f"{bag.stem}{ending}", *words]
    return Offer(job, command, note=note, reason=reason)


def odometry_of(finder: TopicFinder) -> str:
    """Return where odometry comes from: a topic, two frames of /tf, or nowhere (empty)."""
    edge = odometry_edge(finder.frames, BASE_FRAME, MAP_FRAME)
    return finder.odometry.get("odom", f"{TF_TOPIC} ({edge[0]} to {edge[1]})" if edge else "")


Found = tuple[list[str], str, str]  # options, note, reason


def _offer_map(finder: TopicFinder, rig: Path | None) -> Found:
    """From spheres, colour and depth, a stereo pair, or the cameras of a rig."""
    try:
        kind, choice = finder.find_source(has_rig=rig is not None)
    except BagError:
        if finder.offered(DEPTH) or len(finder.views(has_pairs=True)) < MIN_RIG_CAMERAS:
            raise
        kind = CAMERAS
    if kind == CAMERAS:
        return _offer_rig(finder, rig)
    note = NOTES[kind] + REGISTERED * ("depth/camera_info" in choice.topics) + _rectified(choice.topics)
    return options_of(choice.topics), note, choice.reason


NOTES = {"sphere": "from spheres", "rgbd": "from colour and depth", "stereo": "from a stereo pair"}
REGISTERED = ", depth registered to the images by both calibrations and /tf_static"


def _offer_rig(finder: TopicFinder, rig: Path | None) -> Found:
    """By several cameras, named as in the rig file, or as their topics differ."""
    if rig is None:
        note = f"from the cameras of a rig, with {RIG_FILE} (sphere_nav calibrate, or rig-convert) that has these names"
        views = finder.views(has_pairs=True)
        if not views:
            finder.find(["image_raw"])  # says what is wrong
            raise BagError(f"expected images (--image), found {names_with_faults(finder.streams)}")
        return ["--rig", RIG_FILE, *_named_views(views)], note, ""
    names = read_rig(rig).names
    choice = finder.find_rig(names)
    found = {name: choice.topics[f"cameras/{name}/image_raw"] for name in camera_names(choice.topics)}
    lacking = ", ".join(name for name in names if name not in found)
    note = "from the cameras of a rig" + (f", without {lacking}" if lacking else "")
    words = [f"--camera={name}={topic}" for name, topic in found.items()]
    return ["--rig", str(rig), *words], note, choice.reason


def _rectified(topics: Mapping[str, str]) -> str:
    """Return what is done where images are rectified by their names, nothing where none is."""
    found = [name for ours, name in topics.items() if ours.endswith("image_raw") and is_rectified_topic(name)]
    return f"; {', '.join(found)}: rectified, P of camera_info is used" if found else ""


NO_ODOMETRY = f"no place is trusted without odometry (nav_msgs/Odometry, or a frame above {BASE_FRAME} on /tf)"

PANORAMA_NOTE = "ready, if the images, which have no camera_info, are whole spheres (equirectangular)"


def _find_camera(finder: TopicFinder, wanted: Sequence[str] = ()) -> tuple[Choice, list[str]]:
    """Return the images of a camera; where none is calibrated, those that may be whole spheres, and the option then."""
    try:
        return finder.find(wanted) if wanted else finder.find_localizer({}), []
    except BagError:
        with suppress(BagError):
            whole = finder.find(["image_raw"])
            image = finder.by_name[whole.topics["image_raw"]]
            is_calibrated = any(stream.type == CAMERA_INFO and stream.encoding for stream in finder.streams)
            if image.width == 2 * image.height > 0 and not is_calibrated:
                return whole, ["--set", "is_panorama=true"]
        raise


def _offer_localize(finder: TopicFinder, _: Path | None) -> Found:
    """By one camera, or by several that sit on one vehicle."""
    try:
        choice, more = _find_camera(finder)
    except BagError:
        views = finder.views(has_pairs=True)
        if len(views) > 1 and not finder.chosen:
            with suppress(BagError):
                return _offer_cameras(finder, views)
        raise
    words, odometry = options_of(finder.odometry | choice.topics), odometry_of(finder)
    note = PANORAMA_NOTE if more else f"ready, with odometry of {odometry}" if odometry else "ready"
    return words + more, note + _rectified(choice.topics), choice.reason


def _named_views(views: Sequence[Stream]) -> list[str]:
    return [f"--camera={name}={view.topic}" for name, view in zip(names_of_cameras(views), views, strict=True)]


def _offer_cameras(finder: TopicFinder, views: Sequence[Stream]) -> Found:
    """By all cameras: lenses and places by the bag, or of many without by the map of the rig; BagError: by neither."""
    words, frames = _named_views(views), finder.frames
    if len(views) >= MIN_RIG_CAMERAS and not any(stream.type == CAMERA_INFO for stream in finder.streams):
        note = f"ready, by {len(views)} cameras, in a map made by a rig with these names"
        words = ["--set", "rig.calibration=map", *words]
        if not finder.mounting and not frames.is_connected(BASE_FRAME, RigParams().frame):
            note += ", which is taken as the vehicle; --mounting tells otherwise"
            words += ["--mounting", CAMERA_IS_VEHICLE]
        return words, note, ""
    for view in views:
        finder.calibration_of(view)
        if not frames.is_connected(BASE_FRAME, view.frame_id):
            raise BagError(f"expected {view.frame_id} on /tf_static, found no way to it")
    return words, f"ready, by {len(views)} cameras", ""


def _offer_mcl(finder: TopicFinder, _: Path | None) -> Found:
    """In bare geometry."""
    choice, more = _find_camera(finder, ("image_raw", finder.lens))
    words, frame = options_of(finder.odometry | choice.topics), finder.by_name[choice.topics["image_raw"]].frame_id
    if not finder.mounting and not finder.frames.is_connected(BASE_FRAME, frame):
        expected = f"{BASE_FRAME} and {frame or 'the images'} on /tf_static, or the height by --mounting"
        raise BagError(f"expected {expected}, found neither")
    height = (read_mounting(finder.mounting) or finder.frames.lookup(BASE_FRAME, frame)).translation[2]
    if height < MIN_HEIGHT_M:
        expected = f"the height of the camera above {BASE_FRAME} by /tf_static or --mounting"
        raise BagError(f"expected {expected}, found {height:.2f} m")
    clouds = ", ".join(stream.topic for stream in finder.streams if stream.type == CLOUD)
    notes = [f"the bag has point clouds, too ({clouds})"] * bool(clouds) + [NO_ODOMETRY] * (not odometry_of(finder))
    note = PANORAMA_NOTE if more else "; ".join(["ready", *notes]) if notes else ""
    return words + more, note, choice.reason


# What a command is given before the bag, how its output ends, and what finds the rest.
JOBS: dict[str, tuple[Sequence[str], str, Callable[[TopicFinder, Path | None], Found]]] = {
    "map": ((), "_map", _offer_map),
    "localize": ((MAP,), ".tum", _offer_localize),
    "mcl": ((CLOUD_FILE,), "_mcl.tum", _offer_mcl),
}
