"""Where on Earth a point of a survey is: latitude and longitude of its coordinates.

UTM by the series of Krueger (1912) in the third flattening, to its third power: a millimetre within a zone. Zones of
WGS 84 (EPSG:326zz north, 327zz south) and of ETRS89 (258zz), which are the same to half a millimetre of shape; ETRS89
itself moves with Europe, by less than a metre. Other systems by pyproj, where that is installed.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import accumulate
from pathlib import Path

import numpy as np

from mcl_depth.geometry.survey_frame import GeoKey, geo_keys, read_las_head
from sphere_nav.geometry.arrays import Array

AXIS, FLATTENING = 6_378_137.0, 1.0 / 298.257223563  # of WGS 84, m
ECCENTRICITY2 = FLATTENING * (2.0 - FLATTENING)
SCALE, FALSE_EAST, FALSE_NORTH_SOUTH = 0.9996, 500_000.0, 10_000_000.0  # of UTM; m
ZONES = {326: 0.0, 258: 0.0, 327: FALSE_NORTH_SOUTH}  # EPSG codes by hundreds, with their false northing
NUM_ZONES = 60


Degrees = Callable[[float, float], Array]  # east, north in m -> latitude and longitude (2,) in degrees


def degrees_of(crs: str) -> Degrees:
    """Return what tells degrees of a system of coordinates, "EPSG:32632" or "32632"; ValueError for an unknown one."""
    match = re.fullmatch(r"(?:EPSG:)?(\d{4,6})", crs.strip(), re.IGNORECASE)
    if match is None:
        raise ValueError(f"survey.crs: expected EPSG:<code>, found {crs!r}")
    hundred, zone = divmod(int(match[1]), 100)
    if hundred in ZONES and 1 <= zone <= NUM_ZONES:
        return lambda east, north: utm_degrees(east, north - ZONES[hundred], zone)
    return _by_pyproj(int(match[1]))


def place_on_earth(latitude: float, longitude: float, height: float = 0.0) -> tuple[Array, Array]:
    """Return the axes east, north, up (3, 3), in columns, and the position (3,) m about the Earth's center; radians."""
    (s_lat, s_lon), (c_lat, c_lon) = np.sin([latitude, longitude]), np.cos([latitude, longitude])
    up = np.array([c_lat * c_lon, c_lat * s_lon, s_lat])
    east = np.array([-s_lon, c_lon, 0.0])
    radius = AXIS / np.sqrt(1.0 - ECCENTRICITY2 * s_lat**2)
    center = np.array([0.0, 0.0, ECCENTRICITY2 * radius * s_lat])
    return np.stack([east, np.cross(up, east), up], axis=1), (radius + height) * up - center


def utm_degrees(east: float, north: float, zone: int) -> Array:
    """Return latitude and longitude (2,) in degrees of m in a zone; `north` is negative south of the equator."""
    n = FLATTENING / (2.0 - FLATTENING)
    radius = AXIS / (1.0 + n) * (1.0 + n**2 / 4.0 + n**4 / 64.0)  # a meridian by 2 pi
    betas = n / 2 - 2 * n**2 / 3 + 37 * n**3 / 96, n**2 / 48 + n**3 / 15, 17 * n**3 / 480
    deltas = 2 * n - 2 * n**2 / 3 - 2 * n**3, 7 * n**2 / 3 - 8 * n**3 / 5, 56 * n**3 / 15
    xi, eta = north / (SCALE * radius), (east - FALSE_EAST) / (SCALE * radius)
    x = xi - sum(b * np.sin(2 * k * xi) * np.cosh(2 * k * eta) for k, b in enumerate(betas, 1))
    y = eta - sum(b * np.cos(2 * k * xi) * np.sinh(2 * k * eta) for k, b in enumerate(betas, 1))
    chi = np.arcsin(np.sin(x) / np.cosh(y))
    latitude = chi + sum(d * np.sin(2 * k * chi) for k, d in enumerate(deltas, 1))
    longitude = 6.0 * zone - 183.0 + np.degrees(np.arctan2(np.sinh(y), np.cos(x)))
    return np.array([np.degrees(latitude), longitude])


def _by_pyproj(code: int) -> Degrees:
    known = "UTM (EPSG:326zz, 327zz, 258zz)"
    try:
        from pyproj import Transformer
    except ImportError:
        raise ValueError(f"survey.crs: expected {known} where pyproj is not installed, found '{code}'") from None
    try:
        transformer = Transformer.from_crs(f"EPSG:{code}", "EPSG:4326", always_xy=True)
    except Exception as error:  # its own
        raise ValueError(f"survey.crs: expected a projected system, found '{code}': {error}".split("\n")[0]) from None

    def degrees(east: float, north: float) -> Array:
        longitude, latitude = transformer.transform(east, north)
        return np.array([latitude, longitude])

    return degrees


def declared_crs(path: Path) -> str:
    """Return the code EPSG:<code> that a .las or .laz declares, of a folder its first tile; empty where none does."""
    if path.is_dir():
        path = min((file for file in path.iterdir() if file.suffix.lower() in (".las", ".laz")), default=path)
    head = read_las_head(path) if path.suffix.lower() in (".las", ".laz") else b""
    projected = re.search(rb"PROJC(?:S|RS)\[.*", head, re.DOTALL)
    if projected is not None and (code := _last_of_brackets(projected[0])):
        return f"EPSG:{code}"
    key = geo_keys(head).get(GeoKey.PROJECTED, 0)
    return f"EPSG:{key}" if 1024 <= key < 32767 else ""


def _last_of_brackets(text: bytes) -> int:
    """Return the code of a system in WKT: the last in the brackets that its name opens; 0 where there is none."""
    depths = accumulate((byte in b"[(") - (byte in b"])") for byte in text)
    end = next((end for end, depth in enumerate(depths, 1) if depth == 0 and text[end - 1] in b"])"), len(text))
    codes = re.findall(rb'(?:AUTHORITY\["EPSG",\s*"|ID\["EPSG",\s*)(\d{4,6})\b', text[:end])
    return int(codes[-1]) if codes else 0
