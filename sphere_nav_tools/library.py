"""What `import sphere_nav` gives: maps, the localiser, registration, views and recordings, without ROS around them.

Lengths are metres, angles radians, poses `SE3`: `T_map_camera` takes points of the camera (x right, y down, z ahead)
to the map (z up). Images are uint8 arrays [v, u], grey (H, W) or RGB (H, W, 3). What is wrong raises ValueError in one
line, a value of another type TypeError; a file that is damaged raises BagError, a ValueError.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, closing
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import numpy as np

from dense_localizer.localizer import Localizer as ImageLocalizer
from dense_localizer.params import LocalizerParams
from sphere_mapping.acquisition.partial.partial_sphere import RgbdView, sphere_from_view
from sphere_nav.geometry import SE3, DoubleSphere, Fisheye, Omni, Pinhole, Spherical
from sphere_nav.geometry import Camera as CameraModel
from sphere_nav.geometry.arrays import Array, Bytes
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.localization.status import FOLLOWING, TRUSTED, State
from sphere_nav.params import build
from sphere_nav.ros.bags.reader import BagReader
from sphere_nav.ros.bags.recorded import Recorded
from sphere_nav.ros.maps.reader import MapReader as Map
from sphere_nav.ros.maps.reader import open_map as open_map
from sphere_nav.spheres.sphere import Sphere, check_sphere_image, to_gray_bytes, to_rgb
from sphere_nav.view_synthesis.scene import Scene
from sphere_nav.view_synthesis.synthesis import SynthesizedView
from sphere_nav_tools.cli import localize as localize_command
from sphere_nav_tools.cli import mcl as mcl_command
from sphere_nav_tools.cli.register import Registration, register_spheres
from sphere_nav_tools.offline import evaluation, localizing, topics
from sphere_nav_tools.offline.constants import DEFAULT_HZ
from sphere_nav_tools.offline.localizing import RecordedCamera

CAMERAS = (Pinhole, Fisheye, Omni, DoubleSphere, Spherical)
Kind = TypeVar("Kind")


class Camera:
    """Makes cameras. Models for other lenses: `sphere_nav.geometry` (Fisheye, Omni, DoubleSphere, Spherical)."""

    @staticmethod
    def from_fx(
        *,
        width: int,
        height: int,
        fx: float,
        fy: float | None = None,
        cx: float | None = None,
        cy: float | None = None,
        distortion: Sequence[float] = (),
    ) -> Pinhole:
        """Return a pinhole camera.

        Args:
            width: of the image, px.
            height: of the image, px.
            fx: focal length, px.
            fy: the same in rows; fx where it is not given.
            cx: principal point, px, where the centre of the first pixel is 0; the middle where it is not given.
            cy: the same in rows.
            distortion: k1 k2 p1 p2 k3 k4 k5 k6 as in OpenCV; none for rectified images.
        """
        centre = 0.5 * (width - 1) if cx is None else cx, 0.5 * (height - 1) if cy is None else cy
        return Pinhole(width, height, fx, fx if fy is None else fy, *centre, tuple(distortion))


@dataclass(frozen=True, eq=False)
class Estimate:
    """Where a camera is, as far as is known after an image.

    Attributes:
        T_map_camera: the pose; None where the image fits nowhere.
        covariance: (6, 6), m and rad, of xi = (v, omega) in T_map_camera @ exp(xi).
        state: TRACKING or DEGRADED: to be trusted. PROBATION: one place fits, more images have to say so.
            SEARCHING, LOST: no place does.
        reason, remedy: why not, and what helps, in words.
    """

    T_map_camera: SE3 | None
    covariance: Array | None
    state: State
    reason: str
    remedy: str

    @property
    def is_trusted(self) -> bool:
        """Whether a vehicle may go by the pose."""
        return self.state in TRUSTED


class Localizer(AbstractContextManager["Localizer"]):
    """One camera in a map, image by image (M15 section 5).

    with open_map("kitchen") as kitchen, Localizer(kitchen) as localizer:
        print(localizer.localize(image, camera).T_map_camera)

    `parameters` are those of the node `dense_localizer` by dotted name (docs/parameters.md).
    """

    def __init__(self, sphere_map: Map, **parameters: Any) -> None:
        self._localizer = ImageLocalizer(
            build(LocalizerParams, parameters), _expect(sphere_map, Map, "Localizer: map", "open_map(path)")
        )
        self._last_ns = 0

    def localize(self, image: Bytes, camera: CameraModel, stamp_ns: int | None = None) -> Estimate:
        """Find the camera of an image: near that of the image before, the first one anywhere in the map.

        Args:
            image: (H, W) grey or (H, W, 3) RGB, uint8.
            camera: its camera.
            stamp_ns: when it was taken; later than the one before. 0.1 s later where it is not given.

        """
        _expect(camera, CAMERAS, "localize: camera", "Camera.from_fx(...)")
        check_sphere_image(_expect(image, np.ndarray, "localize: image", "an array"), camera)
        self._last_ns = self._last_ns + round(1e9 / DEFAULT_HZ) if stamp_ns is None else stamp_ns
        found = self._localizer.update(to_gray_bytes(image), camera, self._last_ns)
        status, is_placed = found.status, found.status.state in FOLLOWING
        told = found.expose_candidate() if is_placed and found.T_map_camera is None else found  # one on probation
        return Estimate(told.T_map_camera, told.covariance, status.state, str(status.reason), status.remedy)

    def reset(self) -> None:
        """Forget where the camera was: the next image is of another drive."""
        self._localizer.reset()

    def close(self) -> None:
        """End what is being read ahead."""
        self._localizer.references.close()

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        """Close."""
        self.close()


def register(a: RgbdView | Sphere, b: RgbdView | Sphere, T_a_b_guess: SE3 | None = None) -> Registration:
    """Return the motion between two RGB-D images, or spheres with range, by direct registration (M15 section 2).

    The pose of b in a, with axes x ahead, y left, z up. It may be large: features give the first guess. Aligning a with
    b has to agree with aligning b with a; else `is_converged` is false and `reason` says why.
    """
    return register_spheres(_sphere(a, "register: a"), _sphere(b, "register: b"), T_a_b_guess or SE3.identity())


def render(sphere_map: Map, camera: CameraModel, T_map_camera: SE3) -> SynthesizedView:
    """Return what a camera would see from a pose near the key spheres of a map (M15 section 6.3.2).

    `image` (H, W, 3) RGB, `range_m` (H, W) along the ray, NaN where no key sphere saw, and `is_known` (H, W).
    """
    _expect(sphere_map, Map, "render: map", "open_map(path)")
    _expect(camera, CAMERAS, "render: camera", "Camera.from_fx(...)")
    with closing(Scene(sphere_map)) as scene:
        return scene.render(_expect(T_map_camera, SE3, "render: pose", "an SE3"), camera)


def localize_bag(sphere_map: str | Path, bag: str | Path, **options: Any) -> Trajectory:
    """Return the poses of base_link in a map for a recorded drive, with covariances.

    `options` are those of `sphere_nav localize`, such as image="/front/image_raw".
    """
    return _replayed(localize_command, sphere_map, bag, options)


def mcl(cloud: str | Path, bag: str | Path, **options: Any) -> Trajectory:
    """Return the poses of base_link in bare geometry for a recorded drive, by Monte Carlo localisation (N17).

    `options` are those of `sphere_nav mcl`, such as initial_pose="1,2.5,0,0,0,0,1".
    """
    return _replayed(mcl_command, cloud, bag, options)


def read_bag(path: str | Path, wanted: Sequence[str] | None = None) -> Iterator[Recorded]:
    """Yield topic, stamp_ns (of recording) and message of a bag (rosbag2, ROS 1); of some topics or all."""
    with BagReader(path) as bag:
        yield from bag.messages(wanted)


def read_images(path: str | Path, **options: str) -> Iterator[tuple[int, Bytes, CameraModel]]:
    """Yield stamp_ns, RGB image (H, W, 3) and camera of the images of one camera of a bag.

    `options` choose topics as those of commands, such as image="/front/image_raw"; else the only camera is taken.
    """
    parser = argparse.ArgumentParser(prog="read_images", exit_on_error=False)
    topics.add_options(parser, has_cameras=False)
    recorded = RecordedCamera(path, _parsed(parser, [], options))
    for stamp_ns, image in recorded.images():
        yield stamp_ns, to_rgb(image), recorded.camera


def read_trajectory(path: str | Path, topic: str = "") -> Trajectory:
    """Return poses with stamps, and covariances where there are any.

    Of a TUM file (stamp x y z qx qy qz qw; a .cov beside it), or of a bag: of `topic`, else of its ground truth.
    """
    return evaluation.read_trajectory(Path(path), topic, evaluation.TRUTH_TOPICS)


def evaluate(estimate: Trajectory, truth: Trajectory, alignment: str = "none") -> dict[str, Any]:
    """Return the errors of poses: `translation_m`, `rotation_deg`, `lateral_m` ... with median, rmse, p95, max; `nees`.

    The truth is taken at the stamps of the estimate, which is aligned with it first: none, se3 (two frames), or sim3
    (two scales).
    """
    for one, name in ((estimate, "estimate"), (truth, "truth")):
        _expect(one, Trajectory, f"evaluate: {name}", "a Trajectory")
    return evaluation.evaluate_poses(estimate, truth, alignment=alignment, is_interpolated=True).report


def _replayed(command: ModuleType, place: str | Path, bag: str | Path, options: dict[str, Any]) -> Trajectory:
    parser = argparse.ArgumentParser(prog=command.__name__.rsplit(".", 1)[-1], exit_on_error=False)
    command.add_arguments(parser)
    arguments = _parsed(parser, [str(place), str(bag), "-o", "-"], options)
    return localizing.collect(command.replayed(arguments))[0]


def _parsed(parser: argparse.ArgumentParser, words: list[str], options: dict[str, Any]) -> argparse.Namespace:
    """Return arguments of a command; ValueError in one line for an option that it has not."""
    words = words + [f"--{name.replace('_', '-')}={value}" for name, value in options.items()]
    try:
        known, unknown = parser.parse_known_args(words)
    except argparse.ArgumentError as error:
        raise ValueError(f"{parser.prog}: {error}") from None
    if unknown:
        raise ValueError(f"{parser.prog}: expected an option of the command, found {unknown[0]}")
    return known


def _sphere(one: RgbdView | Sphere, name: str) -> Sphere:
    if isinstance(one, RgbdView):
        return sphere_from_view(one)
    return _expect(one, Sphere, name, "RgbdView(image, depth_m, camera) or a Sphere")


def _expect(value: Any, kind: type[Kind] | tuple[type[Any], ...], name: str, expected: str) -> Kind:
    """Return a value; TypeError in one line if it is of another type, as where two arguments are swapped."""
    if not isinstance(value, kind):
        raise TypeError(f"{name}: expected {expected}, found {type(value).__name__}")
    return value
