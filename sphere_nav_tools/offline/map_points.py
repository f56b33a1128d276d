"""The fused cloud of a map: points of all key spheres with normals and colours, as .ply or .laz."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import laspy
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.params import CloudParams
from sphere_nav.geometry.arrays import Bytes, Floats
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.spheres.graph import KeySphere
from sphere_nav.spheres.range_alignment import find_normals
from sphere_nav.spheres.sphere import Sphere, to_rgb

PLY_KIND = [(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")] + [
    (name, "u1") for name in ("red", "green", "blue")
]


@dataclass(frozen=True, eq=False)
class MapPoints:
    """points (N, 3) m in the map, unit normals (N, 3) towards their sphere (0 where unknown), rgb (N, 3)."""

    points: Floats
    normals: Floats
    rgb: Bytes


def cloud_of(node: KeySphere, sphere: Sphere, params: CloudParams) -> MapPoints:
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
    return MapPoints(placed.astype(np.float32), turned.astype(np.float32), rgb[chosen])


def write_ply(path: Path, clouds: list[MapPoints]) -> int:
    """Write a binary PLY; return the number of points."""
    points, normals, rgb = joined(clouds)
    table = np.rec.fromarrays([*points.T, *normals.T, *rgb.T], dtype=PLY_KIND)
    names = {"<f4": "float", "u1": "uchar"}
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}"]
    head += [f"property {names[code]} {name}" for name, code in PLY_KIND] + ["end_header"]
    path.write_bytes(("\n".join(head) + "\n").encode() + table.tobytes())
    return len(table)


def joined(clouds: list[MapPoints]) -> list[NDArray[Any]]:
    """Return the points (N, 3), normals and colours of all clouds."""
    return [np.concatenate([getattr(cloud, name) for cloud in clouds]) for name in ("points", "normals", "rgb")]


def write_laz(path: Path, clouds: list[MapPoints]) -> int:
    """Write LAZ 1.4 with colour and normals (extra bytes of the names that CloudCompare reads); number of points."""
    points, normals, rgb = joined(clouds)
    header = laspy.LasHeader(version="1.4", point_format=7)
    header.scales = np.full(3, 0.001)  # m, step of coordinates
    header.offsets = np.floor(points.min(axis=0)) if len(points) else np.zeros(3)
    header.add_extra_dims([laspy.ExtraBytesParams(f"Normal{axis}", "f4") for axis in "XYZ"])
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T.astype(np.float64)
    for axis, values in zip("XYZ", normals.T, strict=True):
        las[f"Normal{axis}"] = values
    las.red, las.green, las.blue = rgb.T.astype(np.uint16) * 257  # 255 becomes 65535
    with path.open("wb") as file:
        las.write(file, do_compress=True)
    return len(points)
