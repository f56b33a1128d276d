"""Rigs in the files of other programs: Kalibr's camchain, basalt's calibration, OpenCV's FileStorage."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sphere_nav.geometry.cameras.rig import T_BODY_OPTICAL, Rig, RigCamera
from sphere_nav.geometry.files.basalt_file import is_basalt, read_basalt
from sphere_nav.geometry.files.foreign_cameras import ForeignRig
from sphere_nav.geometry.files.kalibr_file import is_kalibr, read_kalibr
from sphere_nav.geometry.files.opencv_file import is_opencv, load_opencv, read_opencv
from sphere_nav.geometry.files.untrusted import told_at

FRAMES = ("camera", "imu")


def read_foreign_cameras(
    paths: Sequence[Path],
    image_size: tuple[int, int] | None = None,
    model: str | None = None,
    unit_m: float = 1.0,
) -> ForeignRig:
    """Return the cameras of one file, or of the two of OpenCV's stereo sample, as written there.

    ValueError in one line if there are none. image_size (width, height), model (pinhole, fisheye) and unit_m, the
    length of the file's unit in metres, are what OpenCV's files may not tell.
    """
    chosen = _format(paths)
    if chosen != "opencv" and len(paths) > 1:
        raise ValueError(f"{paths[1]}: expected one {chosen} file, found {len(paths)}")
    if chosen == "opencv":
        return read_opencv(paths, image_size, model, unit_m)
    return read_kalibr(paths[0]) if chosen == "kalibr" else read_basalt(paths[0])


def _format(paths: Sequence[Path]) -> str:
    values = load_opencv(paths[0])
    for name, is_it in (("kalibr", is_kalibr), ("basalt", is_basalt), ("opencv", is_opencv)):
        if is_it(values):
            return name
    raise ValueError(
        f"{paths[0]}: expected a Kalibr camchain (cam0: ...), a basalt calibration (value0: ...) or an OpenCV "
        "calibration (camera_matrix, M1, R and T), found neither"
    )


def place_rig(found: ForeignRig, frame: str, path: Path) -> Rig:
    """Return the rig in body axes, by frame: "camera" for the first one level and ahead, "imu" for the IMU's axes."""
    if frame == "imu":
        if not found.is_by_imu:
            raise ValueError(f"{path}: expected poses relative to an IMU (--frame imu), found none")
        poses = list(found.T_origin_camera)
    else:
        T_rig_origin = T_BODY_OPTICAL @ found.T_origin_camera[0].inverse()
        poses = [T_rig_origin @ T for T in found.T_origin_camera]
    parts = zip(found.names, found.cameras, poses, strict=True)
    with told_at(path):
        return Rig(tuple(RigCamera(*part) for part in parts), path.stem)
