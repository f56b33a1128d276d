"""Rigs in the files of other programs: Kalibr's camchain, basalt's calibration, OpenCV's FileStorage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from sphere_nav.geometry.arrays import Size
from sphere_nav.geometry.cameras.rig import T_BODY_OPTICAL, Rig
from sphere_nav.geometry.files.basalt_file import is_basalt, read_basalt
from sphere_nav.geometry.files.foreign_cameras import Posed
from sphere_nav.geometry.files.kalibr_file import is_kalibr, read_kalibr
from sphere_nav.geometry.files.opencv_file import load_opencv, read_opencv
from sphere_nav.geometry.files.untrusted import told_at
from sphere_nav.geometry.se3 import SE3

FRAMES = ("camera", "imu")


def read_foreign_rig(
    paths: Sequence[Path],
    frame: str = "camera",
    image_size: Size | None = None,
    model: str | None = None,
    unit_m: float = 1.0,
) -> Rig:
    """Return the cameras of one file, or of the two of OpenCV's stereo sample; ValueError in one line for none.

    frame: "camera" for the first one level and ahead, "imu" for the IMU's axes. image_size (width, height), model
    (pinhole, fisheye) and unit_m, the length of the file's unit in metres, are what OpenCV's files may not tell.
    """
    contents = [load_opencv(path) for path in paths]
    with told_at(" ".join(map(str, paths))):
        cameras, is_by_imu = _read(contents, image_size, model, unit_m)
        if frame == "imu" and not is_by_imu:
            raise ValueError("expected poses relative to an IMU (--frame imu), found none")
        T_rig_origin = SE3.identity() if frame == "imu" else T_BODY_OPTICAL @ cameras[0].T_rig_camera.inverse()
        parts = [replace(part, T_rig_camera=T_rig_origin @ part.T_rig_camera) for part in cameras]
        return Rig(tuple(parts), paths[0].stem)


def _read(contents: Sequence[Any], image_size: Size | None, model: str | None, unit_m: float) -> Posed:
    for is_it, read in ((is_kalibr, read_kalibr), (is_basalt, read_basalt)):
        if is_it(contents[0]):
            if len(contents) > 1:
                raise ValueError(f"expected one file of Kalibr or basalt, found {len(contents)}")
            return read(contents[0])
    return read_opencv(contents, image_size, model, unit_m), False
