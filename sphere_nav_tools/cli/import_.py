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
from sphere_nav_tools.offline.importing.images import open_images
from sphere_nav_tools.offline.importing.nclt import open_nclt
from sphere_nav_tools.offline.importing.recording import Recording
from sphere_nav_tools.offline.importing.rgbd import open_openloris, open_rover, open_seven_scenes, open_tum
from sphere_nav_tools.offline.importing.spherical import open_spherical
from sphere_nav_tools.offline.importing.stereo import open_euroc, open_four_seasons, open_kitti
from sphere_nav_tools.offline.settings import floats, read_positive
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
                cameras/<name>/image_raw. Of one camera (--camera, or a rig file of one): image_raw. Of a stereo pair
                left, right: left/image_raw, right/image_raw; rectified with --camera and --baseline, raw with a rig
                file of left and right. Of a 360 camera (--panorama): image_raw, sphere_info, to localise with.
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
    parser.add_argument("format", choices=READERS, help="what kind of data set it is")
    parser.add_argument("folder", type=Path, metavar="DIR", help="its folder")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="BAG", help="bag to make (a folder)")
    parser.add_argument(
        "--frames", type=frame_range, default=slice(None), metavar="A:B[:STEP]", help="B is not included"
    )
    _add_camera_arguments(parser)


def _add_camera_arguments(parser: argparse.ArgumentParser) -> None:
    rgbd = parser.add_argument_group("seven_scenes, tum, rover, images")
    rgbd.add_argument(
        "--camera",
        type=floats(f"4 to 12 numbers {LENS}", 4, 12),
        metavar=LENS,
        help="(colour) camera, px (seven_scenes 525,525,320,240; tum 525,525,319.5,239.5)",
    )
    images = parser.add_argument_group("images")
    images.add_argument("--rig", type=Path, metavar="FILE", help="rig file of the cameras")
    images.add_argument("--panorama", action="store_true", help="of a 360 camera, equirectangular, 2 H x H")
    images.add_argument("--baseline", type=read_positive, metavar="M", help="m from left to right, or top to bottom")
    images.add_argument("--fps", type=read_positive, metavar="N", help="images a second, unstamped (a video's own; 10)")
    _add_kinect_arguments(parser)
    tum = parser.add_argument_group("tum")
    tum.add_argument("--depth-units", type=float, default=5000.0, metavar="N", help="depth units per m (%(default)s)")


def _add_kinect_arguments(parser: argparse.ArgumentParser) -> None:
    kinect = parser.add_argument_group("seven_scenes", "Its depth is not registered to its colour.")
    kinect.add_argument(
        "--truth-camera",
        choices=("depth", "colour"),
        default="depth",
        help="whose poses the data set gives (%(default)s)",
    )
    kinect.add_argument(
        "--poses", type=Path, metavar="DIR", help="folder of other frame-*.pose.txt (that of the images)"
    )


def run(arguments: argparse.Namespace) -> int:
    """Write the bag."""
    recording = READERS[arguments.format](arguments)
    indices = range(len(recording.instants))[arguments.frames]
    if not indices:
        raise ValueError(f"--frames: expected frames within 0:{len(recording.instants)}, found none")
    with BagWriter(arguments.output) as bag:
        write_frames(bag, recording, progress("import", "frame", indices))
    if recording.write_beside is not None:
        recording.write_beside(arguments.output)
    print(f"{arguments.output}: {len(indices)} frames, truth: {recording.truth or 'none'}")
    return 0


def _seven_scenes(arguments: argparse.Namespace) -> Recording:
    depth_camera, T_color_depth = kinect_camera(LENSES["seven_scenes depth"]), SE3.from_planar(-0.025, 0.0, 0.0)
    return open_seven_scenes(
        arguments.folder,
        kinect_camera(arguments.camera or LENSES["seven_scenes"]),
        (depth_camera, T_color_depth),
        is_truth_of_depth=arguments.truth_camera == "depth",
        poses=arguments.poses,
    )


READERS: dict[str, Callable[[argparse.Namespace], Recording]] = {
    "seven_scenes": _seven_scenes,
    "tum": lambda given: open_tum(given.folder, kinect_camera(given.camera or LENSES["tum"]), given.depth_units),
    "openloris": lambda given: open_openloris(given.folder),
    "rover": lambda given: open_rover(given.folder, kinect_camera(given.camera or LENSES["rover"])),
    "kitti": lambda given: open_kitti(given.folder),
    "euroc": lambda given: open_euroc(given.folder),
    "four_seasons": lambda given: open_four_seasons(given.folder),
    "nclt": lambda given: open_nclt(given.folder),
    "spherical": lambda given: open_spherical(given.folder),
    "images": lambda given: open_images(
        given.folder, given.rig, given.camera, given.baseline, given.fps, is_panorama=given.panorama
    ),
}


def kinect_camera(lens: tuple[float, ...]) -> Pinhole:
    """Return a camera of a Kinect by its lens: fx, fy, cx, cy and the distortion."""
    fx, fy, cx, cy, *distortion = lens
    return Pinhole(*KINECT_SIZE, fx, fy, cx, cy, tuple(distortion))


def write_frames(bag: BagWriter, recording: Recording, indices: Sequence[int]) -> None:
    """Write `/tf_static` and then every message of the frames, at its own stamp."""
    for count, index in enumerate(indices):
        stamp = recording.instants[index].stamp_ns
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
