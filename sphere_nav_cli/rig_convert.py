"""`sphere_nav rig-convert`: a calibration of Kalibr, basalt or OpenCV to rig.yaml."""

from __future__ import annotations

import argparse
import math
import re
from pathlib import Path

import numpy as np

from sphere_geometry.foreign_rig import FORMATS, FRAMES, read_foreign
from sphere_geometry.rig_file import write_rig

HELP = "a calibration of Kalibr, basalt or OpenCV to rig.yaml"
EXAMPLES = """\
examples:
  sphere_nav rig-convert camchain.yaml -o rig.yaml
  sphere_nav rig-convert calibration.json --frame imu -o rig.yaml
  sphere_nav rig-convert intrinsics.yml extrinsics.yml --size 640x480 --unit 0.025 -o rig.yaml

Kalibr: pinhole (radtan, equidistant, none), ds, omni without distortion. basalt: ds, ucm, kb4, pinhole,
pinhole-radtan8. OpenCV: one camera or a stereo pair, YAML of FileStorage. Masks, exposure groups and levels (top,
bottom) are not in these files: add them to rig.yaml by hand.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.epilog = EXAMPLES
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="calibration; two for OpenCV's stereo pair")
    parser.add_argument("--format", choices=FORMATS, help="of the file (told by its content)")
    parser.add_argument(
        "--frame", choices=FRAMES, default="camera", help="the first camera looks along +x, or axes of the IMU (camera)"
    )
    parser.add_argument("--size", metavar="WxH", help="of the images, where an OpenCV file does not tell")
    parser.add_argument("--model", choices=("pinhole", "fisheye"), help="where an OpenCV file does not tell (pinhole)")
    parser.add_argument("--unit", type=float, default=1.0, metavar="M", help="length of OpenCV's unit in m (1)")
    parser.add_argument("-o", "--output", type=Path, required=True, help="rig file to write")
    parser.add_argument("--force", action="store_true", help="replace an existing rig file")


def run(arguments: argparse.Namespace) -> int:
    """Read, tell what was found, write."""
    if not (math.isfinite(arguments.unit) and arguments.unit > 0):
        raise ValueError(f"--unit: expected a positive length in m, found {arguments.unit}")
    rig = read_foreign(
        arguments.files,
        file_format=arguments.format,
        frame=arguments.frame,
        image_size=_size(arguments.size),
        model=arguments.model,
        unit_m=arguments.unit,
    )
    write_rig(arguments.output, rig, is_overwriting=arguments.force)
    for part in rig.cameras:
        place = np.array2string(part.T_rig_camera.translation, precision=4, suppress_small=True)
        ahead = part.T_rig_camera.rotation[:, 2]
        yaw, pitch = np.degrees([math.atan2(ahead[1], ahead[0]), math.asin(float(np.clip(ahead[2], -1.0, 1.0)))])
        print(f"{part.name}: {part.camera.model} at {place} m, looks {yaw:.1f}° to the left, {pitch:.1f}° up")
    return 0


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    found = re.fullmatch(r"(\d+)[x×](\d+)", text)
    if found is None or "0" in found.groups():
        raise ValueError(f"--size: expected WIDTHxHEIGHT such as 640x480, found {text!r}")
    return int(found[1]), int(found[2])
