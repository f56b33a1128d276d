"""A map from a file: points or surfaces, by the ending of its name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mcl_depth.geometry.cloud import Cloud, cloud_from_points
from mcl_depth.geometry.floor_plan import read_floor_plan
from mcl_depth.geometry.las import read_las
from mcl_depth.geometry.mesh import TriangleMesh, mesh_from_faces
from mcl_depth.geometry.pcd import read_pcd
from mcl_depth.geometry.ply import read_ply
from sphere_nav.geometry.files.untrusted import MAX_ARRAY_BYTES, open_file, read_npy

ENDINGS = (".ply", ".pcd", ".las", ".laz", ".npy", ".csv")


def read_geometry(path: str | Path) -> Cloud | TriangleMesh:
    """Read .ply (points, or a mesh where there are faces), .pcd, .las, .laz, .npy (N, 3+), or a floor plan .csv.

    ValueError in one line where the file is damaged, absurd, empty, of another kind, or not there.
    """
    path = Path(path)
    name = str(path)
    open_file(path, f"map ({', '.join(ENDINGS)})", MAX_ARRAY_BYTES).close()  # no FIFO, no device
    match path.suffix.lower():
        case ".ply":
            points, triangles = read_ply(path)
            return mesh_from_faces(points, triangles, name) if len(triangles) else cloud_from_points(points, name)
        case ".pcd":
            return cloud_from_points(read_pcd(path), name)
        case ".las" | ".laz":
            return cloud_from_points(read_las(path), name)
        case ".npy":
            return cloud_from_points(_read_npy(path), name)
        case ".csv":
            return read_floor_plan(path)
        case other:
            raise ValueError(f"{path}: expected a file {', '.join(ENDINGS)}, found {other or 'no ending'}")


def _read_npy(path: Path) -> NDArray[np.floating]:
    found = read_npy(path, "array (N, 3)")
    if found.dtype.names is not None and {"x", "y", "z"} <= set(found.dtype.names):
        return np.stack([found[axis].ravel() for axis in "xyz"], axis=1)
    if found.ndim != 2 or found.shape[1] < 3 or found.dtype.kind not in "fiu":
        raise ValueError(f"{path}: expected numbers of shape (N, 3), found {found.dtype} {found.shape}")
    return np.asarray(found[:, :3], np.float64)
