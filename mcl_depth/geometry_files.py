"""A map from a file: points or surfaces, by the ending of its name."""

from __future__ import annotations

from pathlib import Path

from mcl_depth.cloud import Cloud
from mcl_depth.mesh import TriangleMesh


def read_geometry(path: str | Path) -> Cloud | TriangleMesh:
    """Read .ply (points, or a mesh), .pcd, .las, .npy, or a floor plan .csv."""
    raise NotImplementedError
