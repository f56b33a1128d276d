"""`sphere_nav rig-convert`: a calibration of Kalibr, basalt, OpenCV or OCamCalib to rig.yaml."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from sphere_nav.geometry.cameras.rig import Rig
from sphere_nav.geometry.files.encoded import read_image_file
from sphere_nav.geometry.files.foreign_rig import FORMATS, FRAMES, place_rig, read_foreign_cameras
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav_tools.cli.arguments import add, choose, flag
from sphere_nav_tools.offline.settings import SettingAction, add_output, read_positive, read_size

HELP = """\
A calibration of Kalibr, basalt, OpenCV or OCamCalib to rig.yaml.

examples:
  sphere_nav rig-convert camchain.yaml -o rig.yaml
  sphere_nav rig-convert calibration.json --frame imu -o rig.yaml
  sphere_nav rig-convert intrinsics.yml extrinsics.yml --size 640x480 --unit 0.025 -o rig.yaml
  sphere_nav rig-convert front.yaml rear.yaml --join --mask cam0=front.png --mask cam2=rear.png -o rig.yaml
  sphere_nav rig-convert camchain.yaml --level cam0=top --level cam1=bottom -o rig.yaml
  sphere_nav rig-convert calib_results.txt -o camera.yaml

Kalibr: pinhole (radtan, equidistant, none), ds, omni (none, radtan); several camchains that share the IMU or a camera
(rostopic) with --join. basalt: ds, ucm, kb4, pinhole, pinhole-radtan8. OpenCV: one camera or a stereo pair, YAML of
FileStorage. OCamCalib: calib_results.txt. Every lens keeps its own model; models that the rig file does not have are
refused by name.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "files", "FILE", "calibration; two for OpenCV's stereo pair", Path, nargs="+")
    choose(parser, "--format", FORMATS, "of the file (told by its content)")
    choose(parser, "--frame", FRAMES, "the first camera looks along +x, or axes of the IMU (camera)", "camera")
    add(parser, "--size", "WxH", "of the images, where an OpenCV file does not tell", read_size)
    choose(parser, "--model", ("pinhole", "fisheye"), "where an OpenCV file does not tell (pinhole)")
    add(parser, "--unit", "M", "length of OpenCV's unit in m (1)", read_positive, default=1.0)
    flag(parser, "--join", "merge several camchains into one rig")
    add(parser, "--mask", "CAMERA=MASK", "image, 0 where the camera must not be used", action=SettingAction, default={})
    add(parser, "--level", "CAMERA=LEVEL", "top or bottom", action=SettingAction, default={})
    add(parser, "--exposure-group", "CAMERA=GROUP", "of one exposure", action=SettingAction, default={})
    add_output(parser, "FILE", "rig file to write")


def run(arguments: argparse.Namespace) -> None:
    """Read, tell what was found, write."""
    found = read_foreign_cameras(
        arguments.files,
        arguments.format,
        arguments.size,
        arguments.model,
        arguments.unit,
        is_joining=arguments.join,
    )
    rig = place_rig(found, arguments.frame, arguments.files[0])
    rig = _with_options(rig, arguments)
    write_rig(arguments.output, rig, is_overwriting=arguments.overwrite)
    for part in rig.cameras:
        position = np.array2string(part.T_rig_camera.translation, precision=4, suppress_small=True)
        ahead = part.T_rig_camera.rotation[:, 2]
        yaw, pitch = np.degrees([math.atan2(ahead[1], ahead[0]), math.asin(float(np.clip(ahead[2], -1.0, 1.0)))])
        print(f"{part.name}: {part.camera.model} at {position} m, looks {yaw:.1f}° to the left, {pitch:.1f}° up")


def _with_options(rig: Rig, arguments: argparse.Namespace) -> Rig:
    """Return the rig with the masks, levels and exposure groups of the options."""
    masks, levels = _by_camera(rig, "--mask", arguments.mask), _by_camera(rig, "--level", arguments.level)
    groups = _by_camera(rig, "--exposure-group", arguments.exposure_group)
    for name, mask in masks.items():
        camera, image = rig.camera(name).camera, read_image_file(mask, cv2.IMREAD_GRAYSCALE, "mask")
        found = f"{image.shape[1]} x {image.shape[0]}"
        if image.shape[::-1] != (camera.width, camera.height):
            raise ValueError(f"--mask: {mask}: expected an image of {camera.width} x {camera.height}, found {found}")
    parts = [
        replace(
            part,
            mask=str(Path(masks[part.name]).absolute()) if part.name in masks else None,
            level=levels.get(part.name, ""),
            exposure_group=groups.get(part.name, ""),
        )
        for part in rig.cameras
    ]
    return Rig(tuple(parts), rig.name, rig.version)


def _by_camera(rig: Rig, option: str, found: Mapping[str, Any]) -> dict[str, str]:
    """Return values by camera; ValueError for a camera that the rig has not, or without a value."""
    for name, value in found.items():
        if name not in rig.names or value is None:
            raise ValueError(f"{option}: expected CAMERA=VALUE with one of {', '.join(rig.names)}, found {name!r}")
    return {name: str(value) for name, value in found.items()}
