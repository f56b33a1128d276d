"""Where on Earth a point of a survey is: UTM by its own series, other systems by pyproj where that is installed."""

from __future__ import annotations

import math
from pathlib import Path

import laspy
import numpy as np
import pytest
from scipy.integrate import quad

from mcl_depth.geometry.geodetic import AXIS, FLATTENING, declared_crs, place_on_earth, utm_degrees

WKT = (
    'COMPD_CS["UTM 32N + height",PROJCS["WGS 84 / UTM zone 32N",GEOGCS["WGS 84",AUTHORITY["EPSG","4326"]],'
    'UNIT["metre",1,AUTHORITY["EPSG","9001"]],AUTHORITY["EPSG","32632"]],'
    'VERT_CS["height",UNIT["metre",1,AUTHORITY["EPSG","9001"]],AUTHORITY["EPSG","5783"]]]'
)


def utm(latitude: float, longitude: float) -> tuple[float, float]:
    """Return E and N in zone 33 by Gauss's series in the longitude, near the axis good to a hundredth of a mm."""
    phi, e2 = math.radians(latitude), FLATTENING * (2.0 - FLATTENING)
    arc = quad(lambda p: AXIS * (1 - e2) / (1 - e2 * math.sin(p) ** 2) ** 1.5, 0.0, phi, epsabs=1e-6)[0]
    sin, cos, t, c = math.sin(phi), math.cos(phi), math.tan(phi) ** 2, e2 / (1 - e2) * math.cos(phi) ** 2
    radius, a = AXIS / math.sqrt(1 - e2 * sin**2), math.radians(longitude - 15.0) * cos
    second = 58 * c / cos**2
    x = a + (1 - t + c) * a**3 / 6 + (5 - 18 * t + t**2 + 14 * c - second * sin**2) * a**5 / 120
    y = a**2 / 2 + (5 - t + 9 * c + 4 * c**2) * a**4 / 24 + (61 - 58 * t + t**2) * a**6 / 720
    return 0.9996 * radius * x + 500_000.0, 0.9996 * (arc + radius * math.tan(phi) * y)


@pytest.mark.parametrize("longitude", [14.2, 15.7])
def test_utm_is_right_to_a_millimetre(longitude: float) -> None:
    for latitude in [-35.0, 50.0]:
        found = utm_degrees(*utm(latitude, longitude), 33)
        np.testing.assert_allclose(found, [latitude, longitude], rtol=0.0, atol=7e-9)  # 0.8 mm


@pytest.mark.parametrize("record", ["wkt", "keys"])
def test_a_tile_declares_its_system(tmp_path: Path, record: str) -> None:
    header = laspy.LasHeader(point_format=6, version="1.4")
    if record == "wkt":
        header.vlrs.append(laspy.VLR("LASF_Projection", 2112, "", WKT.encode()))
    elif record == "keys":
        keys = np.array([[1, 1, 0, 2], [1024, 0, 1, 1], [3072, 0, 1, 32632]], "<u2")
        header.vlrs.append(laspy.VLR("LASF_Projection", 34735, "", keys.tobytes()))
    (tmp_path / "tiles").mkdir()
    laspy.LasData(header).write(tmp_path / "tiles" / "a.las")
    expected = "" if record == "none" else "EPSG:32632"
    assert declared_crs(tmp_path / "tiles" / "a.las") == declared_crs(tmp_path / "tiles") == expected
    assert declared_crs(tmp_path / "absent.npy") == ""


def test_axes_and_places_about_the_center_of_the_earth():
    axes, origin = place_on_earth(0.0, 0.0, 10.0)
    np.testing.assert_allclose(origin, [AXIS + 10.0, 0.0, 0.0])
    np.testing.assert_allclose(axes, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-15)
    _, pole = place_on_earth(np.pi / 2, 0.3)
    np.testing.assert_allclose(pole, [0.0, 0.0, AXIS * (1.0 - FLATTENING)], atol=1e-8)
    step = 1e-6  # rad to the north is along the meridian
    (_, south), (axes, north) = place_on_earth(0.8, 0.2), place_on_earth(0.8 + step, 0.2)
    np.testing.assert_allclose((north - south) / np.linalg.norm(north - south), axes[:, 1], atol=1e-6)
