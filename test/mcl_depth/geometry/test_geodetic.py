"""What system a survey declares, in which unit, and where on Earth a point of it is."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest

from mcl_depth.geometry.geodetic import declared_crs, declared_unit, degrees_of

WKT = (
    'COMPD_CS["New York + height",PROJCS["NAD83 / New York Long Island (ftUS)",GEOGCS["NAD83",'
    'DATUM["North_American_Datum_1983",SPHEROID["GRS 1980",6378137,298.257222101]],PRIMEM["Greenwich",0],'
    'UNIT["degree",0.0174532925199433]],PROJECTION["Lambert_Conformal_Conic_2SP"],'
    'PARAMETER["latitude_of_origin",40.1666666666667],PARAMETER["central_meridian",-74],'
    'PARAMETER["standard_parallel_1",41.0333333333333],PARAMETER["standard_parallel_2",40.6666666666667],'
    'PARAMETER["false_easting",984250],PARAMETER["false_northing",0],UNIT["US survey foot",0.304800609601219],'
    'AUTHORITY["EPSG","2263"]],VERT_CS["height",VERT_DATUM["NAVD88",2005],UNIT["metre",1],AUTHORITY["EPSG","5703"]]]'
)


def write_tile(path: Path, wkt: str = "", keys: tuple[tuple[int, int, int, int], ...] = ()) -> Path:
    header = laspy.LasHeader(point_format=6, version="1.4")
    if keys:
        rows = np.array([(1, 1, 0, len(keys)), *keys], "<u2")
        header.vlrs.append(laspy.VLR("LASF_Projection", 34735, "", rows.tobytes()))
    if wkt:
        header.vlrs.append(laspy.VLR("LASF_Projection", 2112, "", wkt.encode() + b"\0"))
    path.parent.mkdir(exist_ok=True)
    laspy.LasData(header).write(path)
    return path


@pytest.mark.parametrize(
    ("wkt", "keys", "code", "unit"),
    [
        (WKT, ((3072, 0, 1, 32632),), 2263, "us-ft"),
        ("of no use", ((1024, 0, 1, 1), (3072, 0, 1, 32632)), 32632, "m"),
        ("of no use", ((3072, 34737, 1, 32767), (3076, 0, 1, 9002)), None, "ft"),
        ("", ((3076, 0, 1, 9036),), None, "km"),
        ("", ((3076, 34736, 1, 9036),), None, ""),  # a number that stands elsewhere
        ("", (), None, ""),
    ],
)
def test_a_tile_declares_its_system_or_its_unit(tmp_path: Path, wkt: str, keys, code: int | None, unit: str) -> None:
    tile = write_tile(tmp_path / "tiles" / "a.las", wkt, keys)
    for path in (tile, tile.parent):
        crs = declared_crs(path)
        codes = [one.to_epsg() for one in (crs.sub_crs_list or [crs])] if crs else [None]
        assert codes[0] == code
    assert declared_unit(tile) == unit
    assert declared_crs(tmp_path / "absent.npy") is None


@pytest.mark.parametrize(
    ("crs", "east", "north", "expected"),
    [
        ("EPSG:32632", 500_000.0, 4_982_950.4, (45.0, 9.0)),
        ("EPSG:32733", 500_000.0, 10_000_000.0, (0.0, 15.0)),
        ("EPSG:2263", 300_000.0, 0.0, (40.1666666666667, -74.0)),  # of 984 250 US survey feet: coordinates are in m
    ],
)
def test_degrees_are_of_meters_whatever_the_unit_of_the_system(crs: str, east, north, expected) -> None:
    np.testing.assert_allclose(degrees_of(crs)(east, north), expected, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize(("crs", "found"), [("EPSG:4326", "WGS 84"), ("EPSG:99999", ".*not found"), ("", "")])
def test_a_system_that_is_none_is_refused_in_one_line(crs: str, found: str) -> None:
    with pytest.raises(ValueError, match=rf"survey\.crs: expected a projected system, found {found}") as caught:
        degrees_of(crs)
    assert "\n" not in str(caught.value)
