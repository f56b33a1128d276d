"""`sphere_nav import`: a recorded data set as a bag with our topics and its truth."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path

from tf2_msgs.msg import TFMessage
from tqdm import tqdm

from node_kit import qos
from node_kit.bags import BagWriter
from sphere_geometry import SE3, Pinhole
from sphere_nav_cli.importing.kitti import KittiRecording
from sphere_nav_cli.importing.layouts import describe, guess_format
from sphere_nav_cli.importing.recording import Recording
from sphere_nav_cli.importing.rgbd import DepthCamera, open_seven_scenes, open_tum
from sphere_nav_cli.importing.spherical import open_spherical

HELP = """\
Turn a recorded data set into an MCAP bag with our topics.

  seven_scenes  Microsoft 7-Scenes: image_raw, camera_info, depth/image_raw (registered to the colour image)
  tum           TUM RGB-D: the same; a sequence with rgb.txt, or a pair img_prev.png, img_curr.png, ...
  kitti         KITTI odometry: left/image_raw, left/camera_info, right/image_raw, right/camera_info
  spherical     rgbd360 rings of eight sensors, or equirectangular image_*.png with range_*.png: sphere

The true poses go to ground_truth/pose: body axes (x forward, y left, z up) of the camera of image_raw, of the left
camera or of the sphere, in the frame map. The optical frames are in /tf_static.

examples:
  sphere_nav import seven_scenes redkitchen/seq-01 -o kitchen --frames 0:120
  sphere_nav import seven_scenes redkitchen/seq-01 -o kitchen --poses colmap_poses --truth-camera colour
  sphere_nav import kitti sequences/06 -o drive
  sphere_nav import kitti sequences/06 -o every_second --frames 0:51:2
"""
FORMATS = ("seven_scenes", "tum", "kitti", "spherical")
KINECT_SIZE = (640, 480)
KINECT_CENTRE = (320.0, 240.0)
COLOUR_FOCAL_LENGTH, DEPTH_FOCAL_LENGTH = 525.0, 585.0
TUM_CAMERA = (525.0, 525.0, 319.5, 239.5)
TUM_UNITS = 5000.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("format", choices=FORMATS, help="what kind of data set it is")
    parser.add_argument("folder", type=Path, metavar="DIR", help="its folder")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="BAG", help="bag to make (a folder)")
    parser.add_argument(
        "--frames", type=frame_range, default=slice(None), metavar="A:B[:STEP]", help="B is not included"
    )
    kinect = parser.add_argument_group("seven_scenes", "Its depth is not registered to its colour.")
    kinect.add_argument("--colour-focal", type=float, default=COLOUR_FOCAL_LENGTH, metavar="PX", help="%(default)s")
    kinect.add_argument("--depth-focal", type=float, default=DEPTH_FOCAL_LENGTH, metavar="PX", help="%(default)s")
    kinect.add_argument(
        "--offset",
        type=numbers(3),
        default=(-0.025, 0.0, 0.0),
        metavar="X,Y,Z",
        help="m; X_colour = X_depth + offset (-0.025,0,0)",
    )
    kinect.add_argument(
        "--truth-camera",
        choices=("depth", "colour"),
        default="depth",
        help="whose poses the data set gives (%(default)s)",
    )
    kinect.add_argument(
        "--poses", type=Path, metavar="DIR", help="folder of other frame-*.pose.txt (that of the images)"
    )
    kinect.add_argument(
        "--registered", action="store_true", help="take colour and depth as one camera of --depth-focal"
    )
    tum = parser.add_argument_group("tum")
    tum.add_argument(
        "--camera", type=numbers(4), default=TUM_CAMERA, metavar="FX,FY,CX,CY", help="px; 525,525,319.5,239.5"
    )
    tum.add_argument(
        "--depth-units", type=float, default=TUM_UNITS, metavar="N", help="depth units per m (%(default)s)"
    )


def run(arguments: argparse.Namespace) -> int:
    """Write the bag."""
    try:
        recording = open_recording(arguments)
    except ValueError as error:
        known = guess_format(arguments.folder) == arguments.format
        raise ValueError("; ".join(filter(None, [str(error), "" if known else describe(arguments.folder)]))) from None
    indices = range(recording.num_frames)[arguments.frames]
    if not indices:
        raise ValueError(f"--frames: expected frames within 0:{recording.num_frames}, found none")
    with BagWriter(arguments.output) as bag:
        write_frames(bag, recording, tqdm(indices, unit="frame", desc="import", disable=None))
        bag.annotate("source", f"{arguments.format} {arguments.folder.name}")
        bag.annotate("truth", recording.truth_name or "none")
    print(f"{arguments.output}: {len(indices)} frames, truth: {recording.truth_name or 'none'}")
    return 0


def open_recording(arguments: argparse.Namespace) -> Recording:
    """Open the data set that the arguments name."""
    if arguments.format == "kitti":
        return KittiRecording(arguments.folder)
    if arguments.format == "spherical":
        return open_spherical(arguments.folder)
    if arguments.format == "tum":
        return open_tum(arguments.folder, Pinhole(*KINECT_SIZE, *arguments.camera), arguments.depth_units)
    depth_camera = DepthCamera(arguments.depth_focal, SE3.exp((*arguments.offset, 0.0, 0.0, 0.0)))
    focal_length = arguments.depth_focal if arguments.registered else arguments.colour_focal
    camera = Pinhole(*KINECT_SIZE, focal_length, focal_length, *KINECT_CENTRE)
    is_truth_of_depth = arguments.truth_camera == "depth"
    return open_seven_scenes(
        arguments.folder,
        camera,
        None if arguments.registered else depth_camera,
        is_truth_of_depth=is_truth_of_depth,
        poses=arguments.poses,
    )


def write_frames(bag: BagWriter, recording: Recording, indices: Sequence[int]) -> None:
    """Write `/tf_static` and then every message of the frames, at its own stamp."""
    for count, index in enumerate(indices):
        stamp = recording.stamp_ns(index)
        if count == 0:
            bag.add_topic("/tf_static", TFMessage, qos.TF_STATIC)
            bag.write("/tf_static", TFMessage(transforms=recording.static_transforms(stamp)), stamp)
        for topic, message in recording.frame(index):
            is_large = topic.endswith(("image_raw", "sphere"))
            bag.add_topic(topic, type(message), qos.LARGE if is_large else qos.STATE)
            bag.write(topic, message, stamp)


def frame_range(text: str) -> slice:
    """Read A:B or A:B:STEP."""
    match = re.fullmatch(r"(\d*):(\d*)(?::([1-9]\d*))?", text)
    if not match:
        raise argparse.ArgumentTypeError(f"expected A:B or A:B:STEP, found {text!r}")
    return slice(*(int(word) if word else None for word in match.groups()))


class numbers:
    """So many numbers, separated by commas."""

    def __init__(self, count: int) -> None:
        self.count = count

    def __call__(self, text: str) -> tuple[float, ...]:
        """Read them."""
        try:
            values = tuple(float(word) for word in text.split(","))
        except ValueError:
            values = ()
        if len(values) != self.count:
            raise argparse.ArgumentTypeError(f"expected {self.count} numbers separated by commas, found {text!r}")
        return values
