"""What every data set is read into: cameras, instants with their images, the truth; and its messages."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped

from sphere_nav.geometry import SE3, Camera, Rig, Spherical
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.ros.conversions import (
    array_to_image,
    camera_to_info,
    camera_to_sphere_info,
    se3_to_odometry,
    se3_to_pose_stamped,
    se3_to_transform,
)
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from sphere_nav_tools.offline.importing.files import require_size
from sphere_nav_tools.offline.importing.frames import Picture, Pictures, instants_of

MAP_FRAME, BASE_FRAME, CAMERA_FRAME, OPTICAL_FRAME = "map", "base_link", "camera_link", "camera_optical"
RIG_FRAME = "rig_link"
T_OPTICAL_BODY = T_BODY_OPTICAL.inverse()
SIDES = ("left", "right")


@dataclass(frozen=True)
class View:
    """A camera: how its topics begin, its frame, its images, its lens and pose.

    `baseline_m` is that of the right camera of a rectified pair.
    """

    prefix: str
    frame_id: str
    camera: Camera
    frames: Pictures
    T_link_camera: SE3 = T_BODY_OPTICAL
    baseline_m: float = 0.0


@dataclass(frozen=True)
class Instant:
    """What was recorded at one time.

    Images by camera; the true pose where it is known; other messages by topic.
    """

    stamp_ns: int
    images: Mapping[str, Picture] = field(default_factory=dict)
    T_map_link: SE3 | None = None
    others: Mapping[str, Callable[[], Any]] = field(default_factory=dict)


@dataclass(frozen=True)
class Recording:
    """A data set: its cameras on a link of the base, its instants, and where its truth comes from.

    The true poses are those of the link, or, `is_truth_of_base`, of base_link on `ground_truth/odometry`.
    `write_beside` writes files that belong into the bag's folder.
    """

    views: Mapping[str, View]
    instants: Sequence[Instant]
    truth: str = ""
    link: str = CAMERA_FRAME
    T_base_link: SE3 = field(default_factory=SE3.identity)
    is_truth_of_base: bool = False
    write_beside: Callable[[Path], None] | None = None

    def static_transforms(self, stamp: int) -> list[TransformStamped]:
        """Return base_link -> the link -> the frames of the cameras."""
        told = {view.frame_id: view.T_link_camera for view in self.views.values() if view.frame_id != self.link}
        frames = [(BASE_FRAME, self.link, self.T_base_link), *((self.link, name, T) for name, T in told.items())]
        return [se3_to_transform(T, stamp, parent, child) for parent, child, T in frames]

    def frame(self, index: int) -> Iterator[tuple[str, Any]]:
        """Yield topic and message of everything that was recorded at one instant: the truth, the lenses, the images."""
        instant = self.instants[index]
        if instant.T_map_link is not None:
            pose, stamp = instant.T_map_link, instant.stamp_ns
            if self.is_truth_of_base:
                found = se3_to_odometry(pose, np.zeros((6, 6)), stamp, (MAP_FRAME, BASE_FRAME))
                yield "ground_truth/odometry", found
            else:
                yield "ground_truth/pose", se3_to_pose_stamped(pose, stamp, MAP_FRAME)
        for topic, make in instant.others.items():
            yield topic, make()
        for name, picture in instant.images.items():
            view = self.views[name]
            if isinstance(view.camera, Spherical):
                yield f"{view.prefix}sphere_info", camera_to_sphere_info(view.camera, view.frame_id)
            else:
                info = camera_to_info(view.camera, picture.stamp_ns, view.frame_id, baseline=view.baseline_m)
                yield f"{view.prefix}camera_info", info
        for name, picture in instant.images.items():
            view, pixels = self.views[name], picture.read()
            require_size(picture.where, pixels, view.camera)
            encoding = "32FC1" if pixels.dtype == np.float32 else "bgr8" if pixels.ndim == 3 else "mono8"
            yield f"{view.prefix}image_raw", array_to_image(pixels, picture.stamp_ns, view.frame_id, encoding)


def camera_recording(views: Mapping[str, View], link: str = CAMERA_FRAME, max_gap_ns: int = 0) -> Recording:
    """Return the images of cameras, as of `instants_of`; the first of an instant is that of the instant."""
    found = instants_of({name: view.frames for name, view in views.items()}, max_gap_ns)
    instants = [Instant(min(one.stamp_ns for one in images.values()), images) for images in found]
    return Recording(views, instants, link=link)


def rig_views(rig: Rig, frames: Mapping[str, Pictures], prefix: str = "cameras/{}/") -> dict[str, View]:
    """Return the cameras of a rig with their images; prefix: how their topics begin, with {} for the name."""
    optical = [(part, frames[part.name], f"{part.name}_optical") for part in rig.cameras]
    return {
        part.name: View(prefix.format(part.name), frame, part.camera, images, part.T_rig_camera)
        for part, images, frame in optical
    }


def pair_views(
    frames: Sequence[Pictures], lenses: Sequence[Camera], T_left_right: SE3, baseline_m: float = 0.0
) -> dict[str, View]:
    """Return a stereo pair whose left camera looks along x of its link; T_left_right between optical axes."""
    poses, baselines = (T_BODY_OPTICAL, T_BODY_OPTICAL @ T_left_right), (0.0, baseline_m)
    return {
        side: View(f"{side}/", f"{side}_optical", lens, images, pose, baseline)
        for side, lens, images, pose, baseline in zip(SIDES, lenses, frames, poses, baselines, strict=True)
    }


def with_truth(
    recording: Recording,
    source: str,
    truth: Trajectory | None,
    max_gap_ns: int = 0,
    T_pose_link: SE3 = T_OPTICAL_BODY,
) -> Recording:
    """Return the recording with the true poses of its instants; `source`: where they come from.

    One between two rows counts where these are at most `max_gap_ns` apart. T_pose_link takes poses to those of the
    link; as it is, from those of an optical frame in a world with z up.
    """
    if truth is None:
        return recording
    found, known = truth.at([instant.stamp_ns for instant in recording.instants], max_gap_ns)
    poses, instants = iter((found.T_map_body @ T_pose_link).matrix), list[Instant]()
    for instant, is_known in zip(recording.instants, known, strict=True):
        instants.append(replace(instant, T_map_link=SE3(next(poses)) if is_known else None))
    return replace(recording, instants=instants, truth=source if known.any() else "")
