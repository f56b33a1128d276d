"""`sphere_nav rig-convert`: a calibration of Kalibr, basalt or OpenCV to rig.yaml."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from sphere_nav.geometry.cameras.rig import T_BODY_OPTICAL
from sphere_nav.geometry.files.foreign_rig import FRAMES, read_foreign_rig
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav_tools.offline.settings import add, add_output, choose, read_positive, read_size

HELP = """\
A calibration of Kalibr, basalt or OpenCV to rig.yaml.

examples:
  sphere_nav rig-convert camchain.yaml -o rig.yaml
  sphere_nav rig-convert calibration.json --frame imu -o rig.yaml
  sphere_nav rig-convert intrinsics.yml extrinsics.yml --size 640x480 --unit 0.025 -o rig.yaml

Kalibr: pinhole (radtan, equidistant, none), ds, omni (none, radtan). basalt: ds, ucm, kb4, pinhole, pinhole-radtan8.
OpenCV: one camera or a stereo pair, YAML of FileStorage. Every lens keeps its own model; models that the rig file does
not have are refused by name. Masks and levels are written into rig.yaml by hand.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "files", "FILE", "calibration; two for OpenCV's stereo pair", Path, nargs="+")
    choose(parser, "--frame", FRAMES, "the first camera looks along +x, or axes of the IMU (camera)", "camera")
    add(parser, "--size", "WxH", "of the images, where an OpenCV file does not tell", read_size)
    choose(parser, "--model", ("pinhole", "fisheye"), "where an OpenCV file does not tell (pinhole)")
    add(parser, "--unit", "M", "length of OpenCV's unit in m (1)", read_positive, default=1.0)
    add_output(parser, "FILE", "rig file to write")


def run(arguments: argparse.Namespace) -> None:
    """Read, tell what was found, write."""
    rig = read_foreign_rig(arguments.files, arguments.frame, arguments.size, arguments.model, arguments.unit)
    write_rig(arguments.output, rig)
    for part in rig.cameras:
        position = np.array2string(part.T_rig_camera.translation, precision=4, suppress_small=True)
        _, pitch, yaw = np.degrees((part.T_rig_camera @ T_BODY_OPTICAL.inverse()).angles)
        print(f"{part.name}: {part.camera.model} at {position} m, looks {yaw:.1f}° to the left, {-pitch:.1f}° up")
