"""`sphere_nav refine-camera`: lens and readout time of a camera from a drive in a map, or where its depth sits."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from tqdm import tqdm

from dense_localizer.localizer import Localizer
from dense_localizer.params import LocalizerParams
from rig_calibration.drive.drive_image import DriveImage, collect
from rig_calibration.drive.drive_lens import Lens
from rig_calibration.drive.mounting import Mounting
from rig_calibration.drive.refinement import RefinedCamera, refine_camera
from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.offline import topics
from sphere_nav.offline.camera_mounting import mounting_by_odometry, mounting_lines, mounting_values
from sphere_nav.offline.recorded_camera import RecordedCamera
from sphere_nav.offline.refine_depth import run_depth
from sphere_nav.offline.settings import parse_settings
from sphere_nav.params import build
from sphere_nav.photometric import build_pyramid
from sphere_nav.ros import conversions
from sphere_nav.ros.conversions import camera_to_info
from sphere_nav.ros.maps.reader import MapReader, open_map

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

Standard deviations come from how differently the images pull; what the drive does not tell is named (status 1).

examples:
  sphere_nav refine-camera campus drive2 -o camera.yaml
  sphere_nav refine-camera campus drive2 -o camera.yaml --image /front/image_raw --images 60
  sphere_nav refine-camera kitchen -o depth.yaml --readout 0.0227
"""
MAX_PAUSE_S = 0.3  # between two images that tell a velocity
ROUNDS = 4  # of localising with the lens found so far and refining it
SETTLED = 1e-4  # relative change of the focal length


@dataclass(frozen=True, eq=False)
class Located:
    """Stamps and poses of the images that were localised."""

    stamps_ns: NDArray[np.int64]
    T_map_camera: tuple[SE3, ...]

    def trajectory(self) -> Trajectory:
        """Return the poses of the camera, optical axes, in the map."""
        return Trajectory(self.stamps_ns, SE3(np.array([T.matrix for T in self.T_map_camera]).reshape(-1, 4, 4)))

    def velocity(self, index: int) -> NDArray[np.float64] | None:
        """Return the velocity (6,) between both neighbours of an image; None where one is missing."""
        if not 0 < index < len(self.stamps_ns) - 1:
            return None
        elapsed_s = float(self.stamps_ns[index + 1] - self.stamps_ns[index - 1]) * 1e-9
        if elapsed_s > 2.0 * MAX_PAUSE_S:
            return None
        moved = self.T_map_camera[index - 1].inverse() @ self.T_map_camera[index + 1]
        return moved.log() / elapsed_s


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("map", metavar="MAP", nargs="?", help="map made by `sphere_nav map`, best by another camera")
    parser.add_argument("source", metavar="BAG", help="bag with images, camera_info, and depth without MAP")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="YAML", help="calibration to write")
    parser.add_argument("--images", type=int, default=40, metavar="N", help="images that are compared (%(default)s)")
    parser.add_argument("--readout", type=float, default=0.0, metavar="S", help="where to start, s (%(default)s)")
    parser.add_argument("--overwrite", action="store_true", help="replace the file that is there")
    topics.add_options(parser)
    parser.add_argument(
        "--set",
        action="append",
        dest="settings",
        default=[],
        metavar="NAME=VALUE",
        help="parameter of dense_localizer, without MAP of sphere_mapper",
    )


def run(arguments: argparse.Namespace) -> int:
    """Localise and refine in turn; 1 if the drive does not tell everything."""
    if arguments.output.exists() and not arguments.overwrite:
        raise ValueError(f"{arguments.output}: expected no such file, found one: --overwrite replaces it")
    if arguments.map is None:
        return run_depth(arguments)
    drive = Drive(arguments)
    lens = Lens.of(drive.camera, arguments.readout)
    with open_map(arguments.map) as sphere_map:
        for _ in range(ROUNDS):
            found = drive.refine(sphere_map, lens)
            change = np.abs(found.lens.values[:2] / lens.values[:2] - 1.0).max()
            lens = found.lens
            if change < SETTLED:
                break
    mounting, reason = mounting_by_odometry(arguments, drive.frame_id, drive.odometry, drive.located.trajectory())
    arguments.output.write_text(text_of(found, drive.frame_id, mounting), encoding="utf-8")
    print("\n".join(report(found, arguments.output)))
    print("\n".join(mounting_lines(mounting)) if mounting else f"no mounting: {reason}")
    return 1 if found.unobserved else 0


class Drive:
    """The images of a bag."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._arguments = arguments
        self._recorded = RecordedCamera(arguments.source, arguments)
        self.camera, self.frame_id = self._recorded.camera, self._recorded.frame_id
        self.odometry = self._recorded.odometry
        self.located = Located(np.empty(0, np.int64), ())

    def refine(self, sphere_map: MapReader, lens: Lens) -> RefinedCamera:
        """Localise the drive with a lens, then refine the lens by images spread over it."""
        given = self._recorded.patience | parse_settings(self._arguments.settings)
        localizer = Localizer(build(LocalizerParams, {"camera.readout": lens.readout} | given), sphere_map)
        try:
            self.located = self._localise(localizer, lens.camera)
            images = list(self._collect(localizer, lens.camera, self.located))
        finally:
            localizer.references.close()
        return refine_camera(images, lens)

    def _localise(self, localizer: Localizer, camera: Camera) -> Located:
        stamps, poses = [], []
        for stamp, image in tqdm(self._images(), desc="localise", unit="image", leave=False, disable=None):
            estimate = localizer.update(image, camera, stamp)
            if estimate.T_map_camera is not None and estimate.candidate is not None:
                stamps.append(stamp)
                poses.append(estimate.T_map_camera)
        return Located(np.array(stamps, np.int64), tuple(poses))

    def _collect(self, localizer: Localizer, camera: Camera, located: Located) -> Iterator[DriveImage]:
        """Yield images spread over the drive, with the pixels of the map that they show."""
        number = min(self._arguments.images, len(located.stamps_ns))
        indices = np.unique(np.linspace(0, len(located.stamps_ns) - 1, number).round().astype(int))
        velocities = {int(located.stamps_ns[i]): (int(i), located.velocity(int(i))) for i in indices}
        if all(velocity is None for _, velocity in velocities.values()):  # too slow for one: no readout, but a lens
            velocities = {stamp: (i, np.zeros(6)) for stamp, (i, _) in velocities.items()}
        for stamp, image in self._images():
            index, velocity = velocities.get(stamp, (0, None))
            if velocity is None:
                continue
            T_map_camera = located.T_map_camera[index]
            choice = localizer.references.choose(T_map_camera, camera)
            if choice.views:
                pyramid = build_pyramid(image, camera, localizer.params.registration.pyramid)
                yield collect(pyramid, choice.views[0], T_map_camera, velocity)

    def _images(self) -> Iterator[tuple[int, NDArray[Any]]]:
        for stamp, message in self._recorded.messages():
            yield stamp, conversions.image_to_grey(message)


def text_of(found: RefinedCamera, frame_id: str, mounting: Mounting | None) -> str:
    """Return the calibration file: that of camera_info_manager, with readout, deviations and mounting beside."""
    info = camera_to_info(found.lens.camera, 0, frame_id)

    def matrix(rows: int, values: Sequence[float]) -> dict[str, Any]:
        return {"rows": rows, "cols": len(values) // rows, "data": [float(value) for value in values]}

    values = {
        "image_width": int(info.width),
        "image_height": int(info.height),
        "camera_name": frame_id,
        "camera_matrix": matrix(3, info.k),
        "distortion_model": info.distortion_model,
        "distortion_coefficients": matrix(1, info.d),
        "rectification_matrix": matrix(3, info.r),
        "projection_matrix": matrix(3, info.p),
        "readout": float(found.lens.readout),
        "standard_deviations": found.deviations,
    }
    return yaml.safe_dump(values | (mounting_values(mounting) if mounting else {}), sort_keys=False)


def report(found: RefinedCamera, output: Path) -> Iterator[str]:
    """Yield what is printed."""
    numbers = f"{len(found.images)} images, {found.num_pixels} pixels, residual {found.residual:.1f} grey levels"
    yield f"{numbers} -> {output}"
    for name, value in zip(found.lens.names, found.lens.values, strict=True):
        note = "  NOT OBSERVED by this drive" if name in found.unobserved else ""
        yield f"{name:<8}{value:12.5f} +- {found.deviations[name]:.5f}{note}"
    if "readout" in found.unobserved:
        yield "the readout shows in motion: record a drive with turns, best with nods and shakes"
    elif found.unobserved:
        yield "record surfaces near and far, all over the image"
