"""Frame-to-frame methods under one face: prepare a reference once, then find where a new frame was taken."""

from __future__ import annotations

from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.rgbd_data import Frame
from sphere_nav.geometry import SE3, Pinhole

MAX_MOTION_M, MAX_MOTION_DEG = 2.0, 90.0  # no peer shall refuse a pair for its motion alone


class Method(Protocol):
    """One row of the table."""

    name: str

    def prepare(self, frame: Frame) -> Any:
        """Do all that depends on the reference alone."""
        ...

    def track(self, reference: Any, frame: Frame) -> SE3 | None:
        """Return T_reference_current of a new frame, or None where the method gives up."""
        ...


class NoMotion:
    """The camera did not move: the error of this row is the motion itself."""

    name = "no motion"

    def prepare(self, frame: Frame) -> None:
        """Nothing to prepare."""

    def track(self, reference: Any, frame: Frame) -> SE3 | None:
        """Return the identity."""
        return SE3.identity()


class OpenCVOdometry:
    """`cv2.Odometry` of OpenCV 5; its result maps points of the first frame into the second."""

    def __init__(self, mode: str, camera: Pinhole, max_depth_m: float) -> None:
        kind = {"RGB": cv2.OdometryType_RGB, "RGB-D": cv2.OdometryType_RGB_DEPTH}[mode]
        self.name = f"OpenCV {mode}"
        settings = cv2.OdometrySettings()
        settings.setCameraMatrix(matrix(camera).astype(np.float32))
        settings.setMaxDepth(max_depth_m)
        settings.setMaxTranslation(MAX_MOTION_M)
        settings.setMaxRotation(MAX_MOTION_DEG)
        self.odometry = cv2.Odometry(kind, settings, cv2.OdometryAlgoType_COMMON)

    def prepare(self, frame: Frame) -> Any:
        """Build pyramids, gradients, normals."""
        prepared = cv2.OdometryFrame(frame.depth_m, frame.gray)
        self.odometry.prepareFrame(prepared)
        return prepared

    def track(self, reference: Any, frame: Frame) -> SE3 | None:
        """Prepare the current frame, then align."""
        current = cv2.OdometryFrame(frame.depth_m, frame.gray)
        self.odometry.prepareFrames(reference, current)  # what the reference already has is not computed again
        is_found, T_current_reference = self.odometry.compute(reference, current)
        return SE3(np.asarray(T_current_reference, np.float64)).inverse() if is_found else None


class Open3DOdometry:
    """Tensor odometry of Open3D, default pyramid and iterations; nothing of a reference can be prepared."""

    def __init__(self, mode: str, camera: Pinhole, max_depth_m: float) -> None:
        import open3d

        self.core, self.geometry = open3d.core, open3d.t.geometry
        self.odometry = open3d.t.pipelines.odometry
        self.name = f"Open3D {mode}"
        self.method = {
            "intensity": self.odometry.Method.Intensity,
            "hybrid": self.odometry.Method.Hybrid,
            "point to plane": self.odometry.Method.PointToPlane,
        }[mode]
        self.intrinsics = self.core.Tensor(matrix(camera))
        self.max_depth_m = max_depth_m

    def prepare(self, frame: Frame) -> Any:
        """Wrap the arrays."""
        color = np.ascontiguousarray(np.repeat(frame.gray[..., None], 3, axis=2))
        depth_m = np.nan_to_num(frame.depth_m, nan=0.0)
        return self.geometry.RGBDImage(
            self.geometry.Image(self.core.Tensor(color)), self.geometry.Image(self.core.Tensor(depth_m))
        )

    def track(self, reference: Any, frame: Frame) -> SE3 | None:
        """Align the current frame to the reference from the identity."""
        result = self.odometry.rgbd_odometry_multi_scale(
            self.prepare(frame),
            reference,
            self.intrinsics,
            self.core.Tensor(np.eye(4)),
            1.0,
            self.max_depth_m,
            method=self.method,
        )
        return SE3(result.transformation.numpy().astype(np.float64))


def matrix(camera: Pinhole) -> NDArray[np.float64]:
    """Return the camera matrix K (3, 3)."""
    return np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])


def peers(camera: Pinhole, max_depth_m: float) -> tuple[list[Method], list[str]]:
    """Return the methods of others that are installed, and a note for each that is not."""
    found: list[Method] = [NoMotion()]
    notes = []
    if hasattr(cv2, "OdometryFrame"):
        found += [OpenCVOdometry(mode, camera, max_depth_m) for mode in ("RGB", "RGB-D")]
    else:
        notes.append(f"OpenCV {cv2.__version__} has no Odometry (expected 5 or later): its rows are left out.")
    try:
        found += [Open3DOdometry(mode, camera, max_depth_m) for mode in ("intensity", "hybrid", "point to plane")]
    except ImportError as error:
        notes.append(f"Open3D is not installed ({error}): its rows are left out.")
    return found, notes
