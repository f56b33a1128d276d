"""`sphere_nav map`: the learning phase, offline, through the very callbacks of the node `sphere_mapper`."""

from __future__ import annotations

import argparse
from pathlib import Path

from sphere_nav_tools.offline import topics
from sphere_nav_tools.offline.mapping.learning import learn
from sphere_nav_tools.offline.settings import FileAction, add, add_overwrite, add_settings, choose, flag, read_count

HELP = """\
Make a map of key spheres from a bag with spheres, RGB-D, stereo images, or the cameras of a rig.

The bag holds spheres; or images, camera_info and depth; or a stereo pair with both camera_info; or, with --rig, the
cameras of a rig, whose images go through the node sphere_stitcher. Raw stereo images are rectified by D, R and P or by
/tf_static; errors that the images show are reported and corrected. Topics of any names are found by type, name, frame
and size (`sphere_nav inspect BAG` shows how), or named by options.

The map frame is that of base_link at the first sphere, level by an IMU of the bag or by the ground. The map is the same
for every number of jobs. Until it is whole, what is mapped stays in MAP.drive.partial, also after a crash, of which
`sphere_nav map-verify` makes a map. Parts of the bag that cannot be read are left out and reported.

examples:
  sphere_nav map kitchen -o kitchen_map
  sphere_nav map kitchen -o kitchen_map --anchor truth --trajectory kitchen.tum
  sphere_nav map campus_drive -o campus --taught campus.tum
  sphere_nav map recording -o hall --image /camera/color/image_raw --depth /camera/aligned_depth_to_color/image_raw
  sphere_nav map drive -o drive_map --anchor survey
  sphere_nav map second_drive -o both_maps --extend drive_map
  sphere_nav map six_cameras -o drive_map --rig rig.yaml --set-stitcher stitch.width=2048 --jobs 2
  sphere_nav map night_drive -o day_and_night --extend day_map --experience night --start 0 0 0
  sphere_nav map six_cameras -o drive_map --rig old_rig.yaml --set-stitcher rectify.num_instants=5
  sphere_nav map drive -o drive_map --set mapper.key.min_overlap=0.5 --set mapper.stereo.nearest_m=2
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "bag", "BAG", "bag of the teaching drive", Path)
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="MAP", help="map to make (a folder)")
    add_overwrite(parser)
    add(parser, "--extend", "MAP0", "a map that the drive is joined to, whatever light either was in", Path)
    add(parser, "--experience", "NAME", "what you call the light or season of this drive", default="")
    add(
        parser,
        "--start",
        ("X", "Y", "YAW"),
        "with --extend: where base_link was in the map at the start, m and rad, to half a metre and 20 deg",
        float,
        nargs=3,
    )
    add(parser, "--budget", "N", "experiences a place may hold; the least used leave first", read_count)
    choose(
        parser,
        "--anchor",
        ("first", "truth", "survey"),
        "first: base_link at the start is the origin; truth: the map as it is, fitted to the truth; survey: every "
        "key sphere where the truth has it, as after a surveyed drive (%(default)s)",
        "first",
    )
    add(parser, "--rig", "F", "rig file, for a bag with the cameras of a rig", Path)
    topics.add_options(parser)
    flag(parser, "--no-loops", "do not look for places seen twice")
    add(parser, "--jobs", "N", "processes that stitch and verify loops (%(default)s)", read_count, default=1)
    add(parser, "--scheduler", "ADDRESS", "do that on a Dask cluster", default="")
    add(parser, "--trajectory", "F", "write the pose of every sphere (TUM)", Path, action=FileAction)
    add(parser, "--taught", "F", "write the vehicle's poses, for path_follower (TUM)", Path, action=FileAction)
    add_settings(parser, "sphere_mapper")
    add_settings(parser, "sphere_stitcher", "--set-stitcher", "set_stitcher")


def run(arguments: argparse.Namespace) -> int:
    """Map what the bag holds."""
    return learn(arguments)
