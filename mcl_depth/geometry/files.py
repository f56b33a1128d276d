"""A map from a file: points or surfaces, by the ending of its name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mcl_depth.geometry.cloud import Cloud, cloud_from_points
from mcl_depth.geometry.floor_plan import read_floor_plan
from mcl_depth.geometry.las import read_las
from mcl_depth.geometry.mesh import TriangleMesh, mesh_from_faces
from mcl_depth.geometry.pcd import read_pcd
from mcl_depth.geometry.ply import read_ply
from mcl_depth.geometry.survey_frame import declared_unit, find_frame
from mcl_depth.params import SurveyParams
from sphere_nav.geometry.files.isolated import read_isolated
from sphere_nav.geometry.files.untrusted import MAX_ARRAY_BYTES, open_file, read_npy

ENDINGS = (".ply", ".pcd", ".las", ".laz", ".npy", ".e57", ".csv")
E57_BYTES, E57_RATIO, E57_S = 1 << 30, 24, 30.0  # memory of its process, beside that by the size of the file; seconds


def read_geometry(path: str | Path, survey: SurveyParams | None = None) -> Cloud | TriangleMesh:
    """Read .ply (points, or a mesh where there are faces), .pcd, .las, .laz, .npy (N, 3+), .e57, or a floor plan .csv.

    Points come in metres, z up, near the origin (`survey_frame.py`); what was done to them is among the warnings.
    ValueError in one line where the file is damaged, absurd, empty, of another kind, or not there.
    """
    path, survey = Path(path), survey or SurveyParams()
    open_file(path, f"map ({', '.join(ENDINGS)})", MAX_ARRAY_BYTES).close()  # no FIFO, no device
    if path.suffix.lower() == ".csv":
        return read_floor_plan(path)
    points, triangles, unit = _read_points(path)
    name, is_mesh = str(path), len(triangles) > 0
    frame = find_frame(points, survey, name, unit, is_mesh=is_mesh)
    points = frame.apply(points)
    made = mesh_from_faces(points, triangles, name) if is_mesh else cloud_from_points(points, name)
    notes = (*made.warnings, frame.words) if frame.words else made.warnings
    return replace(
        made, warnings=notes, origin=(float(frame.origin[0]), float(frame.origin[1]), float(frame.origin[2]))
    )


def _read_points(path: Path) -> tuple[NDArray[np.floating], NDArray[np.int64], str]:
    """Return points (N, 3) as the file has them, triangles (T, 3), and the unit that it declares, if any."""
    nothing = np.zeros((0, 3), np.int64)
    match path.suffix.lower():
        case ".ply":
            return *read_ply(path), ""
        case ".pcd":
            return read_pcd(path), nothing, ""
        case ".las" | ".laz":
            return read_las(path), nothing, declared_unit(path)
        case ".e57":
            return _read_e57(path), nothing, "m"
        case ".npy":
            return _read_npy(path), nothing, ""
        case other:
            raise ValueError(f"{path}: expected a file {', '.join(ENDINGS)}, found {other or 'no ending'}")


def _read_e57(path: Path) -> NDArray[np.float64]:
    size = path.stat().st_size
    points: NDArray[np.float64] = read_isolated(read_scans, path, E57_BYTES + E57_RATIO * size, E57_S + size / 1e6)
    return points


def read_scans(path: Path) -> NDArray[np.float64]:
    """Return the points of all scans of an .e57, each moved to the frame that they share; ValueError without pye57."""
    try:
        import pye57
    except ImportError:
        raise ValueError(f"{path}: expected pye57 for .e57, found it is not installed: pip install pye57") from None
    try:
        file = pye57.E57(str(path))
        scans = [file.read_scan(number, ignore_missing_fields=True) for number in range(file.scan_count)]
    except Exception as error:  # its own, of a library below it
        raise ValueError(f"{path}: expected a whole .e57, found {' '.join(str(error).split())[:200]}") from None
    parts = [np.column_stack([scan[f"cartesian{axis}"] for axis in "XYZ"]) for scan in scans]
    return np.concatenate([np.zeros((0, 3)), *parts])


def _read_npy(path: Path) -> NDArray[np.floating]:
    found = read_npy(path, "array (N, 3)")
    if found.dtype.names is not None and {"x", "y", "z"} <= set(found.dtype.names):
        return np.stack([found[axis].ravel() for axis in "xyz"], axis=1)
    if found.ndim != 2 or found.shape[1] < 3 or found.dtype.kind not in "fiu":
        raise ValueError(f"{path}: expected numbers of shape (N, 3), found {found.dtype} {found.shape}")
    return np.asarray(found[:, :3], np.float64)
