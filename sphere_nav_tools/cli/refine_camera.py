"""`sphere_nav refine-camera`: lens, readout time and mounting of a camera from a drive in a map."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from dense_localizer.localizer import Localizer
from dense_localizer.params import LocalizerParams
from dense_localizer.references.coarse_reference import Sight
from rig_calibration.drive.drive_image import DriveImage, collect
from rig_calibration.drive.drive_lens import Lens
from rig_calibration.drive.mounting import NAMES, Mounting, find_mounting
from rig_calibration.drive.proof import LensProof, lens_distance, prove
from rig_calibration.drive.refinement import refine_camera
from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.rig import T_BODY_OPTICAL
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.params import build
from sphere_nav.photometric import build_pyramid
from sphere_nav.ros.camera.mounting import NAMES as POSE
from sphere_nav.ros.camera.mounting import read_mounting
from sphere_nav.ros.conversions import camera_to_info
from sphere_nav.ros.maps.reader import MapReader, open_map
from sphere_nav.spheres.sphere import to_gray_bytes
from sphere_nav_tools.offline import topics
from sphere_nav_tools.offline.constants import MAX_PAUSE_S, MAX_POSE_GAP_NS, REFINE_ROUNDS, SETTLED_PX
from sphere_nav_tools.offline.evaluation import read_poses, trajectory_of
from sphere_nav_tools.offline.localizing import RecordedCamera
from sphere_nav_tools.offline.settings import add, add_output, add_settings
from sphere_nav_tools.offline.tables import progress, quantity_lines

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


def velocity(located: Trajectory, index: int) -> Array | None:
    """Return the velocity (6,) between both neighbours of an image; None where one is missing."""
    if not 0 < index < len(located) - 1:
        return None
    (before, after), T = located.stamps_ns[[index - 1, index + 1]], located.T_map_body
    elapsed_s = float(after - before) * 1e-9
    return (T[index - 1].inverse() @ T[index + 1]).log() / elapsed_s if elapsed_s <= 2.0 * MAX_PAUSE_S else None


class RecordedDrive:
    """The images of a bag."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._arguments, self.recorded = arguments, RecordedCamera(arguments.source, arguments)
        self.located = trajectory_of([], [])  # the camera, optical axes

    def refine(self, sphere_map: MapReader) -> LensProof:
        """Localise the drive with the lens found so far and refine it, in turn; then judge it by halves of the drive.

        Poses that were found by a lens that is far off are far off themselves.
        """
        given = lens = Lens.of(self.recorded.camera, 0.0)
        for _ in range(REFINE_ROUNDS):
            images = self._locate(sphere_map, lens)
            with progress("refine the lens", "step") as bar:
                found = refine_camera(images, given, progress=bar.update).lens
            is_settled, lens = lens_distance(lens, found) < SETTLED_PX, found
            if is_settled:
                break
        with progress("test it on each half", "step") as bar:
            period_s = np.diff(self.located.stamps_ns).min(initial=np.iinfo(np.int64).max) * 1e-9  # of images
            return prove(images, given, float(period_s), progress=bar.update)

    def _locate(self, sphere_map: MapReader, lens: Lens) -> list[DriveImage]:
        """Localise the drive with a lens; return images spread over it, with what the map shows there."""
        given = self.recorded.patience | self._arguments.settings
        localizer = Localizer(build(LocalizerParams, {"camera.readout": lens.readout} | given), sphere_map)
        try:
            self.located = self._localize(localizer, lens.camera)
            return list(self._collect(localizer, lens.camera))
        finally:
            localizer.references.close()

    def _localize(self, localizer: Localizer, camera: Camera) -> Trajectory:
        stamps, poses = [], []
        for stamp, image in progress("localise", "image", self.recorded.images()):
            candidate = localizer.update(to_gray_bytes(image), camera, stamp).candidate  # a wrong lens is not trusted
            if candidate is not None and candidate.is_accepted:
                stamps.append(stamp)
                poses.append(candidate.T_map_camera)
        return trajectory_of(stamps, poses)

    def _collect(self, localizer: Localizer, camera: Camera) -> Iterator[DriveImage]:
        """Yield images spread over the drive, with the pixels of the map that they show."""
        located = self.located
        number = min(self._arguments.images, len(located.stamps_ns))
        indices = np.unique(np.linspace(0, len(located.stamps_ns) - 1, number).round().astype(int))
        velocities = {int(located.stamps_ns[i]): (int(i), velocity(located, int(i))) for i in indices}
        if all(twist is None for _, twist in velocities.values()):  # too slow for one: no readout, but a lens
            velocities = {stamp: (i, np.zeros(6)) for stamp, (i, _) in velocities.items()}
        for stamp, image in self.recorded.images():
            index, twist = velocities.get(stamp, (0, None))
            if twist is None:
                continue
            T_map_camera = located.T_map_body[index]
            pyramid = build_pyramid(to_gray_bytes(image), camera, localizer.params.registration.pyramid)
            choice = localizer.references.choose(Sight(pyramid.levels[-1], T_map_camera), camera)
            if choice.views:
                yield collect(pyramid, choice.views[0], T_map_camera, twist)


def text_of(proof: LensProof, frame_id: str, mounting: Mounting | None) -> str:
    """Return the calibration file: that of camera_info_manager, with readout, deviations and mounting beside."""
    found = proof.found
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
        "held_out": {name: float(getattr(proof, name)) for name in ("evidence", "limit", "moved_px", "apart_px")},
    }
    return yaml.safe_dump(values | (mounting_values(mounting) if mounting else {}), sort_keys=False)


def mounting_by_odometry(
    arguments: argparse.Namespace, recorded: RecordedCamera, camera: Trajectory
) -> tuple[Mounting | None, str]:
    """Return the mounting by the poses of the camera (optical axes) in the map and the odometry; or none, and why.

    It starts from --mounting or /tf_static; without either the camera may look anywhere.
    """
    if not recorded.odometry:
        return None, "the bag has no odometry"
    given = read_mounting(arguments.mounting)
    if given is None and recorded.frames.is_connected(topics.BASE_FRAME, recorded.frame_id):
        given = recorded.frames.lookup(topics.BASE_FRAME, recorded.frame_id) @ T_BODY_OPTICAL.inverse()
    base, is_known = read_poses(Path(arguments.source), (recorded.odometry,)).at(camera.stamps_ns, MAX_POSE_GAP_NS)
    T_map_body: SE3 = camera.T_map_body[is_known] @ T_BODY_OPTICAL.inverse()
    try:
        return find_mounting(T_map_body, base.T_map_body, given), ""
    except ValueError as error:
        return None, str(error).removeprefix("mounting: ")


def mounting_values(found: Mounting) -> dict[str, dict[str, float]]:
    """Return what the calibration file says: the six numbers that --mounting reads, and deviations beside."""
    values, deviations = (dict(zip(NAMES, map(float, v), strict=True)) for v in (found.values, found.deviations))
    return {"mounting": {name: values[name] for name in POSE}, "mounting_standard_deviations": deviations}


def mounting_lines(found: Mounting) -> Iterator[str]:
    """Yield what is printed."""
    left = "{:.3f} m, {:.4f} rad".format(*found.rms)
    yield f"mounting on {topics.BASE_FRAME}: {found.num_pieces} pieces of the drive, left of each {left}"
    yield from quantity_lines(NAMES, found.values, found.deviations, found.unobserved)
    if found.unobserved:
        yield "a place shows in turns, a height on ramps and bumps only: measure what is missing"
