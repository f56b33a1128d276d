"""The fused cloud of a map: points of all key spheres with normals and colours, as .ply or .laz."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import laspy
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.params import CloudParams
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.spheres.graph import KeySphere
from sphere_nav.spheres.range_alignment import find_normals
from sphere_nav.spheres.sphere import Sphere, to_rgb

COLORS = ("red", "green", "blue")
# m in the map, a unit normal towards its sphere (0 where unknown), levels
POINT = np.dtype([(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")] + [(name, "u1") for name in COLORS])
Cloud = NDArray[Any]  # (N,) of POINT


def cloud_of(node: KeySphere, sphere: Sphere, params: CloudParams) -> Cloud:
    """Return the thinned points of one key sphere in the map frame."""
    rays = pixel_rays(sphere.camera)
    with np.errstate(invalid="ignore"):
        kept = np.isfinite(sphere.range_m) & (sphere.range_m <= params.max_range_m)
    range_m = np.where(kept, sphere.range_m, np.nan).astype(np.float32)
    points = rays * range_m[..., None]
    normals = np.nan_to_num(find_normals(points, range_m, is_whole=sphere.camera.is_whole))
    chosen = np.zeros_like(kept)
    chosen[:: params.step, :: params.step] = kept[:: params.step, :: params.step]
    rgb = to_rgb(sphere.image)
    turned = normals[chosen] @ node.T_map_sphere.rotation.T
    placed = node.T_map_sphere.apply(points[chosen])
    return np.rec.fromarrays([*placed.T, *turned.T, *rgb[chosen].T], dtype=POINT)


def write_ply(path: Path, clouds: list[Cloud]) -> int:
    """Write a binary PLY; return the number of points."""
    table = np.concatenate(clouds)
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}"]
    head += [f"property {'uchar' if name in COLORS else 'float'} {name}" for name in POINT.names or ()] + ["end_header"]
    path.write_bytes(("\n".join(head) + "\n").encode() + table.tobytes())
    return len(table)


def write_laz(path: Path, clouds: list[Cloud]) -> int:
    """Write LAZ 1.4 with colour and normals (extra bytes of the names that CloudCompare reads); number of points."""
    table = np.concatenate(clouds)
    places = np.stack([table[axis] for axis in "xyz"])
    header = laspy.LasHeader(version="1.4", point_format=7)
    header.scales = np.full(3, 0.001)  # m, step of coordinates
    header.offsets = np.floor(places.min(axis=1)) if len(table) else np.zeros(3)
    header.add_extra_dims([laspy.ExtraBytesParams(f"Normal{axis}", "f4") for axis in "XYZ"])
    las = laspy.LasData(header)
    las.x, las.y, las.z = places.astype(np.float64)
    for axis in "xyz":
        las[f"Normal{axis.upper()}"] = table[f"n{axis}"]
    for name in COLORS:
        las[name] = table[name].astype(np.uint16) * 257  # 255 becomes 65535
    with path.open("wb") as file:
        las.write(file, do_compress=True)
    return len(table)
