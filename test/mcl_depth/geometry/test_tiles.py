"""Surveys larger than memory: what is kept of many points, and of tiles in a folder."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest

from mcl_depth.geometry.files import read_geometry
from mcl_depth.geometry.tiles import Thinner
from mcl_depth.params import SurveyParams

ORIGIN = np.array([500_000.0, 5_400_000.0, 0.0])
RNG = np.random.default_rng(5)


def walls(x0: float = 0.0) -> np.ndarray:
    """Return ground of 100 x 100 m and a wall, in UTM."""
    ground = RNG.uniform([x0, 0, 0], [x0 + 100, 100, 0.1], (20_000, 3))
    return ORIGIN + np.concatenate([ground, RNG.uniform([x0 + 50, 0, 0], [x0 + 50.1, 100, 20], (5_000, 3))])


def write_las(path: Path, points: np.ndarray, unit: int = 0) -> None:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 0.001), ORIGIN
    if unit:
        keys = np.array([[1, 1, 0, 1], [3076, 0, 1, unit]], "<u2")
        header.vlrs.append(laspy.VLR("LASF_Projection", 34735, "", keys.tobytes()))
    tile = laspy.LasData(header)
    tile.x, tile.y, tile.z = points.T
    tile.write(path)


def test_of_many_points_one_of_every_cube_is_kept_whatever_comes_at_once():
    points = RNG.uniform(0, 50, (40_000, 3)) + ORIGIN
    dense = np.concatenate([points, RNG.uniform(0, 1, (40_000, 3)) + ORIGIN])  # half of them in one corner
    kept = Thinner(most=10_000)
    for first in range(0, len(dense), 777):
        kept.add(dense[first : first + 777])
    found = kept.points()
    assert 2000 < len(found) <= 10_000
    cubes = np.floor((found - kept._corner) / kept.side)
    assert len(np.unique(cubes, axis=0)) == len(cubes)
    in_corner = np.all(found - ORIGIN < 1.0, axis=1).mean()
    assert in_corner < 0.01  # where half of the points lay
    low, high = (found - ORIGIN).min(axis=0), (found - ORIGIN).max(axis=0)
    assert np.all(low < 3.0)
    assert np.all(high > 47.0)


def test_a_box_bounds_what_counts():
    kept = Thinner(np.array([0.0, 0.0, 10.0, 10.0]))
    kept.add(RNG.uniform(-20, 20, (5000, 3)))
    found = kept.points()
    assert 200 < len(found) < 500
    assert found[:, :2].min() >= 0.0
    assert found[:, :2].max() <= 10.0


@pytest.mark.dds
def test_tiles_of_a_folder_are_one_cloud_with_one_origin(tmp_path: Path):
    parts = [walls(0.0), walls(100.0)]
    write_las(tmp_path / "a.laz", parts[0])
    write_las(tmp_path / "b.las", parts[1])
    np.save(tmp_path / "c.npy", walls(200.0))
    (tmp_path / "readme.txt").write_text("of no use")
    cloud = read_geometry(tmp_path)
    assert (len(cloud.points), cloud.origin) == (75_000, (500_000.0, 5_400_000.0, 0.0))
    assert len(cloud.warnings) == 1  # the origin
    np.testing.assert_allclose(cloud.points[:25_000], parts[0] - ORIGIN, atol=2e-3)


def test_tiles_of_two_units_and_a_folder_without_any_are_refused(tmp_path: Path):
    with pytest.raises(ValueError, match=r"expected tiles .*, found none"):
        read_geometry(tmp_path)
    write_las(tmp_path / "a.las", walls(), 9001)
    write_las(tmp_path / "b.las", walls(), 9002)
    with pytest.raises(ValueError, match=r"expected one unit, found m in a\.las and ft in b\.las; survey\.unit says"):
        read_geometry(tmp_path)
    assert len(read_geometry(tmp_path, SurveyParams(unit="m")).points) == 50_000
