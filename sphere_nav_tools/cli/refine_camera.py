"""`sphere_nav refine-camera`: lens and readout time of a camera from a drive in a map."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from rig_calibration.drive.proof import LensProof
from sphere_nav.ros.maps.reader import open_map
from sphere_nav_tools.offline import topics
from sphere_nav_tools.offline.refine_camera import (
    RecordedDrive,
    mounting_by_odometry,
    mounting_lines,
    text_of,
)
from sphere_nav_tools.offline.settings import add, add_output, add_settings
from sphere_nav_tools.offline.tables import quantity_lines

HELP = """\
Correct the calibration of a camera by a recorded drive, without boards.

Focal lengths, centre, distortion and readout time (rolling shutter). The focal length in camera_info must be
within 5 % of the true one. The result is a calibration file of ROS (camera_info_manager) with `readout` and
`standard_deviations`. Turn and move while recording, past surfaces near and far that fill the image. With odometry in
the bag the file also says where the camera sits on the vehicle (`mounting`; --mounting and the nodes read it).

The lens found from one half of the drive must explain the images of the other half better than camera_info does, and
both halves must agree. Otherwise nothing is written, the status is 1, and the quantities that the drive does not
separate are named. A wrong lens cannot be found in a map that was made with the same wrong lens.

examples:
  sphere_nav refine-camera campus drive2 -o camera.yaml
  sphere_nav refine-camera campus drive2 -o camera.yaml --image /front/image_raw --images 60
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "map", "MAP", "map made by `sphere_nav map`, best by another camera")
    add(parser, "source", "BAG", "bag with images and camera_info")
    add_output(parser, "YAML", "calibration to write")
    add(parser, "--images", "N", "images that are compared (%(default)s)", int, default=40)
    topics.add_options(parser)
    add_settings(parser, "dense_localizer")


def run(arguments: argparse.Namespace) -> int:
    """Localise and refine in turn; 1, with nothing written, if the drive does not prove a better lens."""
    drive = RecordedDrive(arguments)
    with open_map(arguments.map) as sphere_map:
        proof = drive.refine(sphere_map)
    if proof.reasons:
        lines = [*report_camera(proof), "refused, nothing is written: the camera stays as it is given", *proof.reasons]
        print("\n".join(lines))
        return 1
    mounting, reason = mounting_by_odometry(arguments, drive.recorded, drive.located)
    arguments.output.write_text(text_of(proof, drive.recorded.frame_id, mounting), encoding="utf-8")
    print("\n".join([*report_camera(proof), f"-> {arguments.output}"]))
    print("\n".join(mounting_lines(mounting)) if mounting else f"no mounting: {reason}")
    return 0


def report_camera(proof: LensProof) -> Iterator[str]:
    """Yield what is printed."""
    found = proof.found
    yield f"{len(found.states)} images, {found.num_pixels} pixels, residual {found.residual:.1f} grey levels"
    names = found.lens.names
    yield from quantity_lines(names, found.lens.values, map(found.deviations.__getitem__, names), proof.unobserved)
    yield (
        f"held-out halves of the drive: t {proof.evidence:.1f} for it, more than {proof.limit:.1f} is proof; "
        f"{proof.moved_px:.2f} px off the given lens, {proof.apart_px:.2f} px apart"
    )
    if "readout" in proof.unobserved:
        yield "the readout shows in motion: record a drive with turns, best with nods and shakes"
    elif proof.unobserved:
        yield "record surfaces near and far, all over the image"
