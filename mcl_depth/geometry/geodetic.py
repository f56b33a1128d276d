"""The system of coordinates of a survey, by PROJ: the unit that it declares, and latitude and longitude of a point."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError

from mcl_depth.geometry.las import ENDINGS, read_header
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.untrusted import printable

METERS = {"m": 1.0, "ft": 0.3048, "us-ft": 1200.0 / 3937.0, "km": 1000.0, "mm": 0.001}
WKT, GEO_KEYS = 2112, 34735  # records of a .las that declare its system, the better one first
LINEAR_UNITS = 3076  # GeoTIFF key, with a code of EPSG
EPSG_UNITS = {9001: "m", 9002: "ft", 9003: "us-ft", 9036: "km"}

Degrees = Callable[[float, float], Array]  # east, north in m -> latitude and longitude (2,) in degrees


def declared_crs(path: Path) -> CRS | None:
    """Return the system that a .las or .laz declares, of a folder its first tile; None where none does."""
    if path.is_dir():
        path = min((file for file in path.iterdir() if file.suffix.lower() in ENDINGS), default=path)
    return _system_of(_records_of(path))


def declared_unit(path: Path) -> str:
    """Return the unit that a .las or .laz declares, by its system or a key, or an .e57 has; else empty."""
    if path.suffix.lower() == ".e57":
        return "m"
    records = _records_of(path)
    if (crs := _system_of(records)) is not None:
        factor = crs.axis_info[0].unit_conversion_factor if crs.axis_info else 0.0
        return next((unit for unit, meters in METERS.items() if abs(factor / meters - 1.0) < 1e-7), "")
    keys = [key for record in records for key in getattr(record, "geo_keys", ())]
    codes = [key.value_offset for key in keys if key.id == LINEAR_UNITS and key.tiff_tag_location == 0]
    return EPSG_UNITS.get(codes[0], "") if codes else ""


def _records_of(path: Path) -> list[Any]:
    """Return the records of a .las or .laz that declare its system, the better one first; none of another file."""
    if path.suffix.lower() not in ENDINGS:
        return []
    found = read_header(path).vlrs.get_by_id("LASF_Projection", (WKT, GEO_KEYS))
    return sorted(found, key=lambda record: record.record_id)


def _system_of(records: list[Any]) -> CRS | None:
    """Return the first system that can be read; laspy leaves a record that it cannot read as it is."""
    for record in records:
        try:
            if (crs := record.parse_crs()) is not None:
                return crs
        except (CRSError, AttributeError):
            continue
    return None


def degrees_of(crs: CRS | str) -> Degrees:
    """Return what tells degrees of a projected system, such as "EPSG:32632"; ValueError for another one."""
    try:
        crs = CRS(crs)
    except CRSError as error:
        raise ValueError(f"survey.crs: expected a projected system, found {printable(str(error))[:200]}") from None
    if not crs.is_projected:
        raise ValueError(f"survey.crs: expected a projected system, found {crs.name}")
    meters = crs.axis_info[0].unit_conversion_factor
    to_degrees = Transformer.from_crs(crs, "EPSG:4326", always_xy=True)

    def degrees(east: float, north: float) -> Array:
        longitude, latitude = to_degrees.transform(east / meters, north / meters)
        return np.array([latitude, longitude])

    return degrees
