"""The fused cloud of a map: points of all key spheres with normals and colours, as .ply or .laz."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
from numpy.typing import NDArray

from sphere_mapping.params import CloudParams
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.spheres.constants import SURFACE_RATIO
from sphere_nav.spheres.graph import KeySphere
from sphere_nav.spheres.sphere import Sphere

PLY_KIND = [(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")] + [
    (name, "u1") for name in ("red", "green", "blue")
]


@dataclass(frozen=True, eq=False)
class MapPoints:
    """points (N, 3) m in the map, unit normals (N, 3) towards their sphere (0 where unknown), rgb (N, 3)."""

    points: NDArray[np.float32]
    normals: NDArray[np.float32]
    rgb: NDArray[np.uint8]


def cloud_of(node: KeySphere, sphere: Sphere, params: CloudParams) -> MapPoints:
    """Return the thinned points of one key sphere in the map frame."""
    rays = pixel_rays(sphere.camera)
    with np.errstate(invalid="ignore"):
        kept = np.isfinite(sphere.range_m) & (sphere.range_m <= params.max_range_m)
        points = rays * np.where(kept, sphere.range_m, np.nan)[..., None]
    normals = _normals(points, sphere)
    chosen = np.zeros_like(kept)
    chosen[:: params.step, :: params.step] = kept[:: params.step, :: params.step]
    rgb = sphere.image if sphere.image.ndim == 3 else np.repeat(sphere.image[..., None], 3, axis=2)
    turned = normals[chosen] @ node.T_map_sphere.rotation.T
    placed = node.T_map_sphere.apply(points[chosen])
    return MapPoints(placed.astype(np.float32), turned.astype(np.float32), rgb[chosen])


def write_ply(path: Path, clouds: list[MapPoints]) -> int:
    """Write a binary PLY; return the number of points."""
    parts = []
    for cloud in clouds:
        table = np.zeros(len(cloud.points), dtype=PLY_KIND)
        columns = [*cloud.points.T, *cloud.normals.T, *cloud.rgb.T]
        for (name, _), values in zip(PLY_KIND, columns, strict=True):
            table[name] = values
        parts.append(table)
    table = np.concatenate(parts)
    names = {"<f4": "float", "u1": "uchar"}
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(table)}"]
    head += [f"property {names[code]} {name}" for name, code in PLY_KIND] + ["end_header"]
    path.write_bytes(("\n".join(head) + "\n").encode() + table.tobytes())
    return len(table)


def write_laz(path: Path, clouds: list[MapPoints]) -> int:
    """Write LAZ 1.4 with colour and normals (extra bytes of the names that CloudCompare reads); number of points."""
    points = np.concatenate([cloud.points for cloud in clouds]).astype(np.float64)
    header = laspy.LasHeader(version="1.4", point_format=7)
    header.scales = np.full(3, 0.001)  # m, step of coordinates
    header.offsets = np.floor(points.min(axis=0)) if len(points) else np.zeros(3)
    header.add_extra_dims([laspy.ExtraBytesParams(f"Normal{axis}", "f4") for axis in "XYZ"])
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    normals, rgb = np.concatenate([cloud.normals for cloud in clouds]), np.concatenate([cloud.rgb for cloud in clouds])
    for axis, values in zip("XYZ", normals.T, strict=True):
        las[f"Normal{axis}"] = values
    las.red, las.green, las.blue = rgb.T.astype(np.uint16) * 257  # 255 becomes 65535
    with path.open("wb") as file:
        las.write(file, do_compress=True)
    return len(points)


def _normals(points: NDArray[np.float64], sphere: Sphere) -> NDArray[np.float64]:
    """Return unit normals (H, W, 3) from the neighbours on all four sides; 0 where these are elsewhere."""
    wraps = sphere.camera.is_whole
    across = _difference(points, 1, wraps)
    down = _difference(points, 0, False)
    normals = np.cross(down, across)
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        normals = normals / length
    away = np.sum(normals * points, axis=-1, keepdims=True) > 0
    return np.nan_to_num(np.where(away, -normals, normals), posinf=0.0, neginf=0.0)


def _difference(points: NDArray[np.float64], axis: int, wraps: bool) -> NDArray[np.float64]:
    """Return how the surface goes on along an axis: the difference to those neighbours whose range is alike."""
    ranges = np.linalg.norm(points, axis=-1)
    sums, found = np.zeros_like(points), np.zeros(ranges.shape)
    for step in (1, -1):
        other, distance = np.roll(points, -step, axis), np.roll(ranges, -step, axis)
        with np.errstate(invalid="ignore"):
            is_near = (distance < SURFACE_RATIO * ranges) & (ranges < SURFACE_RATIO * distance)
        if not wraps:
            edge: list[slice | int] = [slice(None), slice(None)]
            edge[axis] = -1 if step == 1 else 0
            is_near[tuple(edge)] = False
        sums += np.where(is_near[..., None], step * (other - points), 0.0)
        found += is_near
    return np.where(found[..., None] > 0, sums, np.nan)
