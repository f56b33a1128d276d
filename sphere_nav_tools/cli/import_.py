"""`sphere_nav import`: a recorded data set as a bag with our topics and its truth."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Sequence
from pathlib import Path

from tf2_msgs.msg import TFMessage

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.ros import qos
from sphere_nav.ros.bags import BagWriter
from sphere_nav_tools.offline.importing.files import pinhole
from sphere_nav_tools.offline.importing.images import open_images, open_spherical
from sphere_nav_tools.offline.importing.nclt import open_nclt
from sphere_nav_tools.offline.importing.recording import Recording
from sphere_nav_tools.offline.importing.rgbd import open_openloris, open_rover, open_seven_scenes, open_tum
from sphere_nav_tools.offline.importing.stereo import open_euroc, open_four_seasons, open_kitti
from sphere_nav_tools.offline.settings import add, choose, flag, floats, read_positive
from sphere_nav_tools.offline.tables import progress

HELP = """\
Turn a recorded data set into an MCAP bag with our topics.

  seven_scenes  Microsoft 7-Scenes: image_raw, camera_info, depth/image_raw (registered to the colour image)
  tum           TUM RGB-D: the same; a sequence with rgb.txt, or a pair img_prev.png, img_curr.png, ...
  kitti         KITTI odometry: left/image_raw, left/camera_info, right/image_raw, right/camera_info
  openloris     OpenLORIS-Scene (package): the same, by colour and aligned_depth, on the robot's base_link
  rover         ROVER: the same, by the D435i; its truth has no rotations and is left out
  euroc         EuRoC MAV, TUM-VI (ASL folder with mav0): left/image_raw, right/image_raw with camera_info
  four_seasons  4Seasons: the same, undistorted; the folder calibration inside the recording's or beside it
  nclt          NCLT (a session with lb3; calibration in it or beside it): cameras/cam5/image_raw (ahead) ... cam0 (up),
                undistorted, with camera_info, points of its LiDAR, and BAG/rig.yaml; truth of the vehicle
  spherical     rgbd360 rings of eight sensors, or equirectangular image_*.png with range_*.png: sphere
  images        image files or videos. Of a rig (--rig; each camera a folder or video of its name):
                cameras/<name>/image_raw, camera_info. Of one camera (--camera, or a rig file of one): image_raw. Of a
                stereo pair left, right: left/image_raw, right/image_raw; rectified with --camera and --baseline, raw
                with a rig file of left and right. Of a 360 camera (--panorama): image_raw, sphere_info, to localise
                with.
                Equirectangular pairs top, bottom (--baseline): sphere.
                Names that are times since 1970 are stamps.

The true poses go to ground_truth/pose: body axes (x forward, y left, z up) of the camera of image_raw, of the left
camera or of the sphere, in the frame map. The optical frames are in /tf_static. NCLT: to ground_truth/odometry, of
base_link.

examples:
  sphere_nav import seven_scenes redkitchen/seq-01 -o kitchen --frames 0:120
  sphere_nav import seven_scenes redkitchen/seq-01 -o kitchen --poses colmap_poses --truth-camera colour
  sphere_nav import kitti sequences/06 -o drive
  sphere_nav import kitti sequences/06 -o every_second --frames 0:51:2
  sphere_nav import images six_folders -o drive --rig rig.yaml --fps 15
  sphere_nav import images pair -o drive --camera 707.1,707.1,601.9,183.1 --baseline 0.537
  sphere_nav import images panoramas -o spheres --baseline 0.2
  sphere_nav import images walk_360.mp4 -o drive --panorama
"""
KINECT_SIZE = (640, 480)
LENSES = {  # fx, fy, cx, cy in px, as the data sets' pages tell them
    "seven_scenes": (525.0, 525.0, 320.0, 240.0),
    "seven_scenes depth": (585.0, 585.0, 320.0, 240.0),
    "tum": (525.0, 525.0, 319.5, 239.5),
    "rover": (596.195, 593.141, 327.046, 245.161, 0.07561608, -0.208873, -0.00233474, 0.00401036),
}
LENS = "FX,FY,CX,CY[,K1,K2,P1,P2,K3,K4,K5,K6]"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    choose(parser, "format", READERS, "what kind of data set it is")
    add(parser, "folder", "DIR", "its folder", Path)
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="BAG", help="bag to make (a folder)")
    add(parser, "--frames", "A:B[:STEP]", "B is not included", frame_range, default=slice(None))
    rgbd = parser.add_argument_group("seven_scenes, tum, rover, images")
    add(
        rgbd,
        "--camera",
        LENS,
        "(colour) camera, px (seven_scenes 525,525,320,240; tum 525,525,319.5,239.5)",
        floats(f"4 to 12 numbers {LENS}", 4, 12),
    )
    images = parser.add_argument_group("images")
    add(images, "--rig", "FILE", "rig file of the cameras", Path)
    flag(images, "--panorama", "of a 360 camera, equirectangular, 2 H x H")
    add(images, "--baseline", "M", "m from left to right, or top to bottom", read_positive)
    add(images, "--fps", "N", "images a second, unstamped (a video's own; 10)", read_positive)
    kinect = parser.add_argument_group("seven_scenes", "Its depth is not registered to its colour.")
    choose(kinect, "--truth-camera", ("depth", "colour"), "whose poses the data set gives (%(default)s)", "depth")
    add(kinect, "--poses", "DIR", "folder of other frame-*.pose.txt (that of the images)", Path)
    tum = parser.add_argument_group("tum")
    add(tum, "--depth-units", "N", "depth units per m (%(default)s)", float, default=5000.0)


def run(arguments: argparse.Namespace) -> None:
    """Write the bag."""
    recording = READERS[arguments.format](arguments)
    indices = range(len(recording.instants))[arguments.frames]
    if not indices:
        raise ValueError(f"--frames: expected frames within 0:{len(recording.instants)}, found none")
    with BagWriter(arguments.output) as bag:
        write_frames(bag, recording, indices)
    if recording.write_beside is not None:
        recording.write_beside(arguments.output)
    print(f"{arguments.output}: {len(indices)} frames, truth: {recording.truth or 'none'}")


def _seven_scenes(given: argparse.Namespace) -> Recording:
    camera = _kinect(given, "seven_scenes")
    depth = pinhole(KINECT_SIZE, LENSES["seven_scenes depth"]), SE3.from_planar(-0.025, 0.0, 0.0)  # T_color_depth
    is_truth_of_depth = given.truth_camera == "depth"
    return open_seven_scenes(given.folder, camera, depth, is_truth_of_depth=is_truth_of_depth, poses=given.poses)


def _kinect(given: argparse.Namespace, name: str) -> Pinhole:
    return pinhole(KINECT_SIZE, given.camera or LENSES[name])


PLAIN: dict[str, Callable[[Path], Recording]] = {  # those that are a folder and nothing else
    "openloris": open_openloris,
    "kitti": open_kitti,
    "euroc": open_euroc,
    "four_seasons": open_four_seasons,
    "nclt": open_nclt,
    "spherical": open_spherical,
}
READERS: dict[str, Callable[[argparse.Namespace], Recording]] = {
    "seven_scenes": _seven_scenes,
    "tum": lambda given: open_tum(given.folder, _kinect(given, "tum"), given.depth_units),
    "rover": lambda given: open_rover(given.folder, _kinect(given, "rover")),
    **dict.fromkeys(PLAIN, lambda given: PLAIN[given.format](given.folder)),
    "images": lambda given: open_images(
        given.folder, given.rig, given.camera, given.baseline, given.fps, is_panorama=given.panorama
    ),
}


def write_frames(bag: BagWriter, recording: Recording, indices: Sequence[int]) -> None:
    """Write `/tf_static` and then every message of the frames, at its own stamp."""
    first = recording.instants[indices[0]].stamp_ns
    bag.add_topic("/tf_static", TFMessage, qos.TF_STATIC)
    bag.write("/tf_static", TFMessage(transforms=recording.static_transforms(first)), first)
    for index in progress("import", "frame", indices):
        stamp = recording.instants[index].stamp_ns
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
