"""sensor_msgs/CameraInfo against camera models."""

from __future__ import annotations

from copy import copy

import numpy as np
from sensor_msgs.msg import CameraInfo

from sphere_nav.geometry import Camera, Fisheye, Pinhole
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.untrusted import told_at
from sphere_nav.geometry.plausible import check_center, check_length
from sphere_nav.ros.conversions.headers import header

ROTATION_TOLERANCE = 1e-3
FISHEYE = "equidistant"
COEFFICIENTS = {"plumb_bob": 5, "rational_polynomial": 8, FISHEYE: 4}  # name -> their number


def camera_from_info(info: CameraInfo) -> Pinhole | Fisheye:
    """Return the camera of the raw image by K and D; `as_rectified` tells that of the rectified one.

    A region of interest moves the centre; binning by b takes u to (u + 1/2) / b - 1/2, as pixels are summed.
    """
    name = _name_of(info)
    fx, fy, cx, cy = (float(info.k[place]) for place in (0, 4, 2, 5))
    if fx == 0.0 or fy == 0.0:
        raise ValueError(f"{name}: K[0]: expected a calibrated camera, found focal length 0")
    if info.k[1] != 0.0 or info.k[8] != 1.0:
        raise ValueError(f"{name}: K: expected no skew and a last row 0 0 1, found {list(map(float, info.k))}")
    roi, bin_x, bin_y = info.roi, max(int(info.binning_x), 1), max(int(info.binning_y), 1)
    width, height = int(roi.width or info.width) // bin_x, int(roi.height or info.height) // bin_y
    cx, cy = cx - roi.x_offset, cy - roi.y_offset
    cx, cy = (cx + 0.5) / bin_x - 0.5, (cy + 0.5) / bin_y - 0.5
    lengths = (width, height, fx / bin_x, fy / bin_y, cx, cy)
    coefficients = tuple(float(value) for value in info.d)
    with told_at(name):
        camera = _model(info.distortion_model, coefficients, lengths)
        if not (roi.width or roi.height):  # what is cut out may lie anywhere
            check_center(camera, "camera_info")
        return camera


def _name_of(info: CameraInfo) -> str:
    return " ".join(info.header.frame_id.split()) or "camera_info"


def camera_to_info(camera: Camera, stamp: int, frame_id: str, *, baseline: float = 0.0) -> CameraInfo:
    """Return the CameraInfo of a pinhole or fisheye camera; `baseline` in m of the right camera of a rectified pair."""
    if not isinstance(camera, Pinhole | Fisheye):
        raise ValueError(f"CameraInfo: expected a pinhole or fisheye camera, found {camera.model}: use SphereInfo")
    fx, fy, cx, cy = float(camera.fx), float(camera.fy), float(camera.cx), float(camera.cy)
    is_long = any(camera.distortion[5:])
    model = FISHEYE if isinstance(camera, Fisheye) else "rational_polynomial" if is_long else "plumb_bob"
    size = COEFFICIENTS[model]
    return CameraInfo(
        header=header(stamp, frame_id),
        width=camera.width,
        height=camera.height,
        distortion_model=model,
        d=[float(value) for value in (*camera.distortion, *(0.0,) * size)[:size]],
        k=[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        r=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p=[fx, 0.0, cx, -fx * baseline if baseline else 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    )


def rectification_of(info: CameraInfo) -> Array:
    """Return R (3, 3), from the axes of the raw camera to those of the rectified one; zeros are told as no turn."""
    R = np.array(info.r, dtype=np.float64).reshape(3, 3)
    if not R.any():
        return np.eye(3)
    if not np.allclose(R @ R.T, np.eye(3), atol=ROTATION_TOLERANCE) or np.linalg.det(R) < 0:
        raise ValueError(f"{_name_of(info)}: R: expected a rotation, found {list(info.r)}")
    return R


def has_baseline(right: CameraInfo) -> bool:
    """Return whether a right CameraInfo tells the rectified pair: P[3] = -fx * baseline."""
    return bool(right.p[0] > 0.0 and right.p[3] < 0.0)


def stereo_baseline(right: CameraInfo) -> float:
    """Return the distance in m of a right camera that `has_baseline` from the left one (P[3] = -fx B)."""
    baseline_m = -float(right.p[3]) / float(right.p[0])
    check_length("baseline", baseline_m, f"{right.header.frame_id}: P[3]: baseline")
    return baseline_m


def as_rectified(info: CameraInfo, *, is_rectified: bool = True) -> CameraInfo:
    """Return the calibration of the rectified images beside which image_proc and others send that of the raw ones.

    P is its K, there is no D and no R left. As it is, where `is_rectified` is false, or without D and P.
    """
    if not is_rectified or not (any(info.d) or info.p[0]):
        return info
    if not info.p[0] or not info.p[5]:
        raise ValueError(
            f"{_name_of(info)}: P[0]: expected a calibrated camera of rectified images, found focal length 0"
        )
    found = copy(info)
    found.k = [info.p[0], 0.0, info.p[2], 0.0, info.p[5], info.p[6], 0.0, 0.0, 1.0]
    found.d, found.distortion_model, found.r = [], "", np.eye(3).ravel()
    return found


def is_rectified_topic(topic: str) -> bool:
    """Whether images are rectified by their name, as image_proc and drivers have it: image_rect, rect/image ..."""
    return any(word in ("rect", "rectified") for word in topic.replace("/", "_").lower().split("_"))


def check_image_size(camera: Camera, width: int, height: int) -> None:
    """Raise ValueError unless an image has the size of its camera."""
    if (width, height) != (camera.width, camera.height):
        raise ValueError(
            f"image size: expected {camera.width} x {camera.height} (camera_info), found {width} x {height}"
        )


Lengths = tuple[int, int, float, float, float, float]


def _model(name: str, d: tuple[float, ...], lengths: Lengths) -> Pinhole | Fisheye:
    if name in ("", "none") and not any(d):
        return Pinhole(*lengths)
    if name not in COEFFICIENTS:
        raise ValueError(f"distortion_model: expected {', '.join(COEFFICIENTS)}, found {name!r}")
    number = COEFFICIENTS[name]
    if any(d[number:]):
        remedy = f"rectify the images (image_proc) and use image_rect, or calibrate anew with {number}"
        raise ValueError(f"D: expected at most {number} coefficients of {name}, found {len(d)}: {remedy}")
    if name == FISHEYE:
        if len(d) < number:
            raise ValueError(f"D: expected {number} coefficients of {name}, found {len(d)}")
        return Fisheye(*lengths, distortion=(d[0], d[1], d[2], d[3]))
    return Pinhole(*lengths, distortion=d[:number] if any(d) else ())
