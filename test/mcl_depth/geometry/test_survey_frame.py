"""A surveyor's file: units, the axis that points up, a shift; the cloud that comes out is always the same street."""

from __future__ import annotations

from contextlib import nullcontext
from itertools import product
from pathlib import Path

import laspy
import numpy as np
import pytest

from mcl_depth.geometry.files import read_geometry
from mcl_depth.geometry.survey_frame import find_frame, survey_box
from mcl_depth.params import SurveyParams

UTM = np.array([500_213.4, 5_412_345.6, 212.0])


def street() -> np.ndarray:
    """A street of 60 x 20 m with a house on either side, a point every 0.4 m; z up, near the origin."""
    x, y = np.meshgrid(np.arange(0, 60, 0.4), np.arange(0, 20, 0.4))
    ground = np.column_stack([x.ravel(), y.ravel(), 0.02 * x.ravel()])
    x, z = np.meshgrid(np.arange(5, 55, 0.4), np.arange(0.4, 8, 0.4))
    walls = [np.column_stack([x.ravel(), np.full(x.size, y), z.ravel() + 0.02 * x.ravel()]) for y in (2.0, 18.0)]
    return np.concatenate([ground, *walls])


STREET = street()


def read(path: Path, points: np.ndarray, **survey: str):
    np.save(path / "a.npy", points)
    return read_geometry(path / "a.npy", SurveyParams(**survey))


def test_a_tile_in_utm_is_shifted_by_whole_hundreds_or_by_what_is_given(tmp_path: Path) -> None:
    found = read(tmp_path, STREET + UTM)
    assert found.origin == (500_200.0, 5_412_300.0, 0.0)
    assert "its origin is E,N,H = 500200,5412300,0 m" in found.warnings[0]
    np.testing.assert_allclose(found.points + np.array(found.origin), STREET + UTM, atol=1e-4)
    found = read(tmp_path, STREET + UTM, origin="500213.4,5412345.6,212")
    np.testing.assert_allclose(found.points, STREET, atol=1e-4)
    with pytest.raises(ValueError, match=r"survey\.origin: expected E,N,H in m, found '1,2'"):
        read(tmp_path, STREET, origin="1,2")


def test_the_unit_is_found_by_the_extent_and_named(tmp_path: Path) -> None:
    found = read(tmp_path, STREET / 0.001)
    assert "taken as mm" in found.warnings[0]
    np.testing.assert_allclose(found.points, STREET, atol=1e-3)


@pytest.mark.dds
def test_feet_are_those_that_the_file_declares(tmp_path: Path) -> None:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, 0.001)
    keys = np.array([[1, 1, 0, 1], [3076, 0, 1, 9003]], "<u2")
    header.vlrs.append(laspy.VLR("LASF_Projection", 34735, "", keys.tobytes()))
    tile = laspy.LasData(header)
    tile.x, tile.y, tile.z = (STREET / 0.304800609601219).T
    for name in ("a.las", "a.laz"):
        tile.write(tmp_path / name)
        found = read_geometry(tmp_path / name)
        assert "taken as us-ft (as the file declares)" in found.warnings[0]
        np.testing.assert_allclose(found.points, STREET, atol=2e-3)


def test_a_plain_and_degrees_are_refused_in_one_line(tmp_path: Path) -> None:
    plain = STREET * [1.0, 1.0, 0.0] + np.random.default_rng(0).normal(0, 0.02, STREET.shape)
    with pytest.raises(ValueError, match=r"a\.npy: points: expected walls or the like above the ground, found 0\.00%"):
        read(tmp_path, plain)
    with pytest.raises(ValueError, match="longitude and latitude"):
        read(tmp_path, STREET * [1e-5, 1e-5, 1.0] + [8.4, 49.0, 100.0])


def test_a_point_far_outside_of_all_others_is_refused_before_it_tells_unit_axis_or_area() -> None:
    """Half a street is 10 m by the nearest 99.9 % of it; a point 500 m away may have been seen through a gap."""
    for axis, sign in product(range(3), (1.0, -1.0)):
        for far in (5e2, 2e4, 1e9):
            stray = np.insert(STREET, 7, sign * far * np.eye(3)[axis], axis=0)
            if far == 5e2:
                assert find_frame(stray, SurveyParams(unit="m", up="z"), "a").words == ""
                continue
            with pytest.raises(ValueError, match=r"a: points: expected one place, found 99\.9% in a width"):
                find_frame(stray, SurveyParams(), "a")


def test_a_place_to_drive_is_a_metre_to_a_kilometre_wide() -> None:
    """A point every 7 m in a wider one: those who scan walk closer."""
    for wide, unit in [(0.9, "km"), (1.1, "m"), (1050.0, "mm")]:
        for declared in ("", "ft"):
            street = STREET * wide / np.ptp(STREET, axis=0).max()
            assert find_frame(street, SurveyParams(), "a", declared, is_mesh=True).unit == (declared or unit)


def test_something_stands_on_three_of_a_thousand_squares() -> None:
    """5041 squares of 1.41 m: 15 of them."""
    for number, is_refused in [(10, True), (20, False)]:
        x, y = np.meshgrid(np.linspace(0.0, 100.0, 200), np.linspace(0.0, 100.0, 200))
        poles = np.arange(number)[:, None] * [4.0, 3.0, 0.0] + [2.0, 2.0, 3.0]
        points = np.concatenate([np.column_stack([x.ravel(), y.ravel(), 0.0 * x.ravel()]), poles])
        with pytest.raises(ValueError, match="walls or the like") if is_refused else nullcontext():
            assert find_frame(points, SurveyParams(), "a").words == ""


def test_a_line_of_points_ten_thousand_kilometers_long_is_refused_by_few_squares() -> None:
    """Of half a metre they would be 20 million."""
    line = np.linspace(0.0, 1e7, 20_000)[:, None] * [1.0, 0.0, 0.0]
    with pytest.raises(ValueError, match=r"squares of 2\.5e\+03 m"):
        find_frame(line, SurveyParams(unit="m"), "a")


def test_y_is_up_where_half_as_much_again_lies_across_it() -> None:
    """A floor of 20 x 12 m, and a wall of 20 m and this height: level ones, whatever they are."""
    for height, up in [(14.0, "z"), (23.0, "y")]:
        x, y = np.meshgrid(np.arange(0.0, 20.0, 0.2), np.arange(0.0, 12.0, 0.2))
        floor = np.column_stack([x.ravel(), y.ravel(), 0.0 * x.ravel()])
        x, z = np.meshgrid(np.arange(0.0, 20.0, 0.2), np.arange(0.2, height, 0.2))
        wall = np.column_stack([x.ravel(), np.full(x.size, 12.0), z.ravel()])
        assert find_frame(np.concatenate([floor, wall]), SurveyParams(), "a").up == up


def test_what_of_a_file_counts_is_in_its_own_unit() -> None:
    survey, limits = SurveyParams(origin="1000,2000,50"), np.array([0.0, -5.0, 10.0, 20.0])
    np.testing.assert_allclose(survey_box(survey, limits, "ft"), np.array([1000, 1995, 1010, 2020]) / 0.3048)
    assert survey_box(survey, limits, "") is None
    assert survey_box(survey, None, "m") is None
    assert survey_box(SurveyParams(), limits, "m") is None
    assert survey_box(SurveyParams(origin="1000,2000,50", up="y"), limits, "m") is None


@pytest.mark.dds
def test_an_e57_is_read_where_its_reader_is_installed_and_else_says_what_to_install(tmp_path: Path) -> None:
    (tmp_path / "a.e57").write_bytes(b"ASTM-E57")
    with pytest.raises(ValueError, match=r"a\.e57: expected (a whole \.e57|pye57 for)"):
        read_geometry(tmp_path / "a.e57")
    pye57 = pytest.importorskip("pye57")
    with pye57.E57(str(tmp_path / "b.e57"), mode="w") as file:
        file.write_scan_raw({f"cartesian{axis}": column for axis, column in zip("XYZ", STREET.T, strict=True)})
    np.testing.assert_allclose(read_geometry(tmp_path / "b.e57").points, STREET, atol=1e-4)
