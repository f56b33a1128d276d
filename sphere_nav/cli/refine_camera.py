"""`sphere_nav refine-camera`: lens and readout time of a camera from a drive in a map, or where its depth sits."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from rig_calibration.drive.proof import LensProof
from sphere_nav.offline import topics
from sphere_nav.offline.refine_camera import RecordedDrive, mounting_by_odometry, mounting_lines, run_depth, text_of
from sphere_nav.offline.settings import add_settings
from sphere_nav.ros.maps.reader import open_map

HELP = """\
Estimate what is wrong with the calibration of a camera from a drive, by the images alone.

With MAP: focal lengths, centre, distortion and readout time (rolling shutter). Give what camera_info says, or a guess:
within 5 % of the focal length will do. The result is a calibration file of ROS (camera_info_manager) with `readout` and
`standard_deviations` beside. Turn and move while recording: a readout time shows in motion, a lens in surfaces near and
far all over the image. With odometry in the bag the file says, too, where the camera sits on the vehicle (`mounting`,
which --mounting and the nodes read from it).

Without MAP: where the depth camera of an RGB-D camera sits beside the image's, from a bag with images and depth. The
result is a file for the parameter depth_pose of sphere_mapper. Move by half of the distance to what is seen, in all
directions, before surfaces of several slopes; give --readout for a rolling shutter. The scale of depth is not told: the
motion would be scaled alike.

With MAP the result must prove itself: what one half of the drive finds must explain the other half's images better than
camera_info does, and both halves must agree. Else nothing is written, status is 1, and what is not told apart is named.
Standard deviations come from how differently stretches of the drive pull and, in a map of partial spheres, from what
the lens that made the map may be off: a wrong lens in a map of the same wrong lens cannot be found.
Without MAP what the drive does not tell is named (status 1).

examples:
  sphere_nav refine-camera campus drive2 -o camera.yaml
  sphere_nav refine-camera campus drive2 -o camera.yaml --image /front/image_raw --images 60
  sphere_nav refine-camera kitchen -o depth.yaml --readout 0.0227
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("map", metavar="MAP", nargs="?", help="map made by `sphere_nav map`, best by another camera")
    parser.add_argument("source", metavar="BAG", help="bag with images, camera_info, and depth without MAP")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="YAML", help="calibration to write")
    parser.add_argument("--images", type=int, default=40, metavar="N", help="images that are compared (%(default)s)")
    parser.add_argument("--readout", type=float, default=0.0, metavar="S", help="where to start, s (%(default)s)")
    parser.add_argument("--overwrite", action="store_true", help="replace the file that is there")
    topics.add_options(parser)
    add_settings(parser, "dense_localizer, without MAP of sphere_mapper")


def run(arguments: argparse.Namespace) -> int:
    """Localise and refine in turn; 1, with nothing written, if the drive does not prove a better lens."""
    if arguments.output.exists() and not arguments.overwrite:
        raise ValueError(f"{arguments.output}: expected no such file, found one: --overwrite replaces it")
    if arguments.map is None:
        return run_depth(arguments)
    drive = RecordedDrive(arguments)
    with open_map(arguments.map) as sphere_map:
        proof = drive.refine(sphere_map)
    if proof.reasons:
        lines = [*report_camera(proof), "refused, nothing is written: the camera stays as it is given", *proof.reasons]
        print("\n".join([*lines, *proof.weak()]))
        return 1
    mounting, reason = mounting_by_odometry(arguments, drive.frame_id, drive.odometry, drive.located.trajectory())
    arguments.output.write_text(text_of(proof, drive.frame_id, mounting), encoding="utf-8")
    print("\n".join([*report_camera(proof), f"-> {arguments.output}", *(proof.weak() if proof.unobserved else ())]))
    print("\n".join(mounting_lines(mounting)) if mounting else f"no mounting: {reason}")
    return 0


def report_camera(proof: LensProof) -> Iterator[str]:
    """Yield what is printed."""
    found = proof.found
    yield f"{len(found.states)} images, {found.num_pixels} pixels, residual {found.residual:.1f} grey levels"
    for name, value in zip(found.lens.names, found.lens.values, strict=True):
        note = "  NOT OBSERVED by this drive" if name in proof.unobserved else ""
        yield f"{name:<8}{value:12.5f} +- {found.deviations[name]:.5f}{note}"
    yield (
        f"held-out halves of the drive: t {proof.evidence:.1f} for it, more than {proof.limit:.1f} is proof; "
        f"{proof.moved_px:.2f} px off the given lens, {proof.apart_px:.2f} px apart"
    )
    if "readout" in proof.unobserved:
        yield "the readout shows in motion: record a drive with turns, best with nods and shakes"
    elif proof.unobserved:
        yield "record surfaces near and far, all over the image"
