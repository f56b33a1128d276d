"""A map from a file: points or surfaces, by the ending of its name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import MAX_COORDINATE_M
from mcl_depth.geometry.cloud import Geometry, cloud_from_points
from mcl_depth.geometry.floor_plan import read_floor_plan
from mcl_depth.geometry.geodetic import declared_unit
from mcl_depth.geometry.las import ENDINGS as LAS_ENDINGS
from mcl_depth.geometry.las import read_header, read_las, seconds_for
from mcl_depth.geometry.mesh import mesh_from_faces
from mcl_depth.geometry.pcd import read_pcd
from mcl_depth.geometry.ply import points_of, read_ply
from mcl_depth.geometry.survey_frame import SurveyFrame, find_frame, survey_box
from mcl_depth.geometry.tiles import Thinner, in_box
from mcl_depth.params import SurveyParams
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.isolated import read_isolated
from sphere_nav.geometry.files.untrusted import MAX_ARRAY_BYTES, open_file, read_npy

TILE_ENDINGS = (".ply", ".pcd", ".las", ".laz", ".npy", ".e57")
ENDINGS = (*TILE_ENDINGS, ".csv")
MAX_COORDINATE = 1e3 * MAX_COORDINATE_M  # of a file, which may be in millimetres
E57_BYTES, E57_RATIO = 1 << 30, 24  # memory of its process, beside that by the size of the file


def read_geometry(path: str | Path, survey: SurveyParams | None = None, limits: Array | None = None) -> Geometry:
    """Read .ply (points, or a mesh where there are faces), .pcd, .las, .laz, .npy (N, 3+), .e57, or a floor plan .csv.

    Points come in metres, z up, near the origin (`survey_frame.py`); what was done to them is among the warnings.
    A folder is one of tiles, of which a map of `limits` (x0, y0, x1, y1) m may need a part. ValueError in one line
    where a file is damaged, absurd, empty, of another kind, or absent.
    """
    path, survey = Path(path), survey or SurveyParams()
    if path.suffix.lower() == ".csv":
        return read_floor_plan(path)
    tiles = sorted(file for file in path.iterdir() if file.suffix.lower() in TILE_ENDINGS) if path.is_dir() else [path]
    if not tiles:
        raise ValueError(f"{path}: expected tiles ({', '.join(TILE_ENDINGS)}), found none")
    return _read_tiles(path, tiles, survey, limits)


def _read_tiles(path: Path, tiles: list[Path], survey: SurveyParams, limits: Array | None) -> Geometry:
    """Return the points of all tiles as one cloud, or the mesh that the only one is."""
    kept, units, total = Thinner(), dict[str, Path](), 0
    for tile in tiles:
        unit = survey.unit if survey.unit != "auto" else declared_unit(tile)
        box = survey_box(survey, limits, unit)
        points, triangles = _read_points(tile, box)
        if len(triangles) and tile is path:
            frame = find_frame(points, survey, str(path), is_mesh=True)
            return _in_frame(mesh_from_faces(frame.apply(points), triangles, str(path)), frame)
        total += read_header(tile).point_count if tile.suffix.lower() in LAS_ENDINGS else len(points)
        kept.add(points if box is None else points[in_box(points, box)])
        units.setdefault(unit, tile)
    if len(units) > 1:
        (first, one), (second, other) = list(units.items())[:2]
        raise ValueError(
            f"{path}: tiles: expected one unit, found {first or 'none declared'} in {one.name}"
            f" and {second or 'none declared'} in {other.name}; survey.unit says which"
        )
    points = kept.points()
    frame = find_frame(points, survey, str(path), next(iter(units)))
    made = _in_frame(cloud_from_points(frame.apply(points), str(path)), frame)
    if total > len(points):
        made = replace(made, warnings=(*made.warnings, f"{path}: {len(points)} of {total} points, evenly over space"))
    return made


def _in_frame(made: Geometry, frame: SurveyFrame) -> Geometry:
    notes = (*made.warnings, frame.words) if frame.words else made.warnings
    return replace(made, warnings=notes, origin=tuple(frame.origin.tolist()))


def _read_points(path: Path, box: Array | None) -> tuple[NDArray[np.floating], NDArray[np.int64]]:
    """Return points (N, 3) as the file has them, and triangles (T, 3).

    Of a .las, only what lies within `box` (x0, y0, x1, y1). ValueError for a number that is no coordinate of the Earth.
    """
    open_file(path, f"map ({', '.join(ENDINGS)})", MAX_ARRAY_BYTES).close()  # no FIFO, no device
    points, triangles = _parse(path, box)
    with np.errstate(invalid="ignore"):
        absurd = np.flatnonzero((np.abs(points) > MAX_COORDINATE).any(axis=1) & np.isfinite(points).all(axis=1))
    if absurd.size:
        found = f"{points[absurd[0]].tolist()}"
        raise ValueError(f"{path}: point {absurd[0]}: expected coordinates up to {MAX_COORDINATE:g}, found {found}")
    return points, triangles


def _parse(path: Path, box: Array | None) -> tuple[NDArray[np.floating], NDArray[np.int64]]:
    nothing = np.zeros((0, 3), np.int64)
    match path.suffix.lower():
        case ".ply":
            return read_ply(path)
        case ".pcd":
            return read_pcd(path), nothing
        case ".las" | ".laz":
            return read_las(path, box), nothing
        case ".e57":
            memory = E57_BYTES + E57_RATIO * path.stat().st_size
            return read_isolated(read_scans, path, memory, seconds_for(path)), nothing
        case ".npy":
            return _read_npy(path), nothing
        case other:
            raise ValueError(f"{path}: expected a file {', '.join(ENDINGS)}, found {other or 'no ending'}")


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
        return points_of(found)
    if found.ndim != 2 or found.shape[1] < 3 or found.dtype.kind not in "fiu":
        raise ValueError(f"{path}: expected numbers of shape (N, 3), found {found.dtype} {found.shape}")
    return np.asarray(found[:, :3], np.float64)
