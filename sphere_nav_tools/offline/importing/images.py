"""Plain images: of a rig, of one camera, of a stereo pair, or pairs of panoramas, one above the other."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray

from sphere_mapping.acquisition.params import MatchParams
from sphere_mapping.acquisition.range.epipolar import disparities_of_ranges, range_from_disparity
from sphere_mapping.acquisition.range.matching import match_columns
from sphere_mapping.acquisition.range.semi_global import check_order
from sphere_nav.geometry import SE3, Camera, Pinhole, Rig, RigCamera, Spherical
from sphere_nav.geometry.files.rig_file import read_rig
from sphere_nav.ros.conversions import array_to_image, camera_to_info, se3_to_transform
from sphere_nav.spheres.sphere import T_BODY_OPTICAL, Sphere
from sphere_nav_tools.offline.importing.frames import Frames, instants_of, open_frames
from sphere_nav_tools.offline.importing.recording import BASE_FRAME, OPTICAL_FRAME, camera_transforms, require_folder
from sphere_nav_tools.offline.importing.spherical import SphereRecording

RIG_FRAME = "rig_link"
STEREO = ("left", "right")
LEVELS = ("top", "bottom")


class CameraRecording:
    """Images of cameras: `cameras/<name>/image_raw` of a rig, `image_raw` of one, `left/`, `right/` of a pair."""

    truth_name = ""

    def __init__(self, cameras: dict[str, Frames], rig: Rig, hz: float | None) -> None:
        self.cameras, self.rig = cameras, rig
        self.instants = instants_of(cameras, hz)
        self.num_frames = len(self.instants)
        self.has_infos = len(rig.cameras) == 1 or rig.names == STEREO

    def static_transforms(self, stamp: int) -> list[TransformStamped]:
        """Return base_link -> rig_link (identity), or -> camera_link -> the optical frames."""
        if not self.has_infos:
            return [se3_to_transform(SE3.identity(), stamp, BASE_FRAME, RIG_FRAME)]
        return camera_transforms(stamp, {self._frame(part.name): part.T_rig_camera for part in self.rig.cameras})

    def stamp_ns(self, index: int) -> int:
        """Return the stamp of an instant: that of its first image."""
        return min(stamp for _, stamp in self.instants[index].values())

    def frame(self, index: int) -> Iterator[tuple[str, Any]]:
        """Yield the images of an instant, each with its own stamp."""
        for name, (number, stamp) in self.instants[index].items():
            image, camera = self.cameras[name].read(number), self.rig.camera(name).camera
            if image.shape[1::-1] != (camera.width, camera.height):
                found = f"expected {camera.width} x {camera.height} pixels, found {image.shape[1]} x {image.shape[0]}"
                raise ValueError(f"{self.cameras[name].path}: image {number}: {found}")
            topic, frame_id = self._topic(name), self._frame(name)
            if self.has_infos:
                yield f"{topic}camera_info", camera_to_info(camera, stamp, frame_id)
            yield f"{topic}image_raw", array_to_image(image, stamp, frame_id, "bgr8" if image.ndim == 3 else "mono8")

    def _topic(self, name: str) -> str:
        return f"cameras/{name}/" if not self.has_infos else "" if len(self.rig.cameras) == 1 else f"{name}/"

    def _frame(self, name: str) -> str:
        return OPTICAL_FRAME if len(self.rig.cameras) == 1 else f"{name}_optical"


class RectifiedRecording(CameraRecording):
    """A rectified stereo pair of one lens, told by its baseline."""

    def __init__(self, cameras: dict[str, Frames], rig: Rig, baseline_m: float, hz: float | None) -> None:
        super().__init__(cameras, rig, hz)
        self.baseline_m = baseline_m

    def frame(self, index: int) -> Iterator[tuple[str, Any]]:
        """Yield both images; the camera_info of the right one tells the baseline."""
        for topic, message in super().frame(index):
            if topic == "right/camera_info":
                message.p[3] = -message.p[0] * self.baseline_m
            yield topic, message


class PanoramaPairs(SphereRecording):
    """Equirectangular pairs, 2 H x H: folders or videos top and bottom, `baseline_m` apart -> spheres with range."""

    def __init__(self, folder: Path, baseline_m: float, hz: float | None) -> None:
        self.cameras = {level: open_frames(folder, level) for level in LEVELS}
        self.instants = [part for part in instants_of(self.cameras, hz) if len(part) == len(LEVELS)]
        if not self.instants:
            raise ValueError(f"{folder}: expected pairs of one time in top and bottom, found none")
        self.baseline_m, self.params, self._has_order = baseline_m, MatchParams(), False
        super().__init__([folder] * len(self.instants), {}, "")

    def stamp_ns(self, index: int) -> int:
        """Return the stamp of the top image."""
        return self.instants[index]["top"][1]

    def sphere(self, index: int, stamp: int) -> Sphere:
        """Match the pair; range is that of the top centre."""
        pair = [self._read(level, self.instants[index][level][0]) for level in LEVELS]
        top, bottom = pair
        if top.shape != bottom.shape:
            raise ValueError(f"{self.cameras['bottom'].path}: expected the size of top, found another")
        gray = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image for image in pair]
        if not self._has_order:
            check_order(gray[0].astype(np.uint8), gray[1].astype(np.uint8), LEVELS, is_whole=True)
            self._has_order = True
        window = Spherical(top.shape[1], top.shape[0])
        search, everywhere = (
            disparities_of_ranges(window, self.baseline_m, self.params),
            np.ones(gray[0].shape, np.bool_),
        )
        disparity = match_columns(gray[0], gray[1], search, self.params, everywhere, 1)
        range_m, std_m = range_from_disparity(disparity, window, self.baseline_m, self.params)
        image = cv2.cvtColor(top, cv2.COLOR_BGR2RGB).astype(np.uint8) if top.ndim == 3 else top
        return Sphere(np.maximum(image, 1), range_m, window, stamp, std_m)

    def _read(self, level: str, number: int) -> NDArray[np.uint8]:
        image = self.cameras[level].read(number)
        if image.shape[1] != 2 * image.shape[0]:
            found = f"expected 2 H x H pixels of a whole sphere, found {image.shape[1]} x {image.shape[0]}"
            raise ValueError(f"{self.cameras[level].path}: image {number}: {found}")
        return image


def open_images(
    folder: Path, rig: Path | None, lens: tuple[float, ...] | None, baseline_m: float | None, hz: float | None
) -> CameraRecording | PanoramaPairs:
    """Open what the options tell: a rig file, a lens (with a baseline: rectified left and right), or top and bottom."""
    if baseline_m is not None and not baseline_m > 0:
        raise ValueError(f"--baseline: expected a positive length in m, found {baseline_m}")
    if hz is not None and not hz > 0:
        raise ValueError(f"--fps: expected a positive number, found {hz}")
    if not folder.is_file():
        require_folder(folder)
    if rig is not None:
        found = read_rig(rig)
        places = [""] if len(found.cameras) == 1 else list(found.names)
        return CameraRecording({n: open_frames(folder, p) for n, p in zip(found.names, places, strict=True)}, found, hz)
    if baseline_m is not None and lens is None:
        return PanoramaPairs(folder, baseline_m, hz)
    if lens is None:
        raise ValueError(
            f"{folder}: images: expected --rig, --camera (one camera, with --baseline a rectified pair) or --baseline"
        )
    names = ("camera",) if baseline_m is None else STEREO
    cameras = {name: open_frames(folder, name if len(names) > 1 else "") for name in names}
    model = _pinhole(cameras[names[0]], lens)
    if baseline_m is None:
        return CameraRecording(cameras, _rig({"camera": (model, 0.0)}), hz)
    return RectifiedRecording(cameras, _rig({"left": (model, 0.0), "right": (model, -baseline_m)}), baseline_m, hz)


def _rig(cameras: dict[str, tuple[Camera, float]]) -> Rig:
    """Return cameras that look ahead, each so far to the left (m)."""
    parts = [
        RigCamera(name, camera, SE3.from_parts(T_BODY_OPTICAL.rotation, [0.0, left_m, 0.0]))
        for name, (camera, left_m) in cameras.items()
    ]
    return Rig(tuple(parts))


def _pinhole(frames: Frames, lens: tuple[float, ...]) -> Pinhole:
    """Return the camera of a lens fx, fy, cx, cy and distortion, of the size of the first image."""
    again = open_frames(frames.path, "")  # a video is read once, from its beginning
    height, width = again.read(0).shape[:2]
    fx, fy, cx, cy, *distortion = lens
    return Pinhole(width, height, fx, fy, cx, cy, tuple(distortion))
