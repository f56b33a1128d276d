"""Ranges of several sources become one."""

import numpy as np

from sphere_mapping.acquisition.params import FusionParams
from sphere_mapping.acquisition.range.fusion import fill, range_from_cloud, range_from_depth
from sphere_mapping.acquisition.stitching.views import RigView
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.params import build

WHOLE = Spherical(64, 32)
LENS = Pinhole(60, 40, 40.0, 40.0, 29.5, 19.5)


def test_depth_along_the_axis_becomes_range_along_the_ray():
    """A wall 2 m before the camera: the range grows to the sides, the deviation with the square of the depth."""
    optical = SE3.from_parts([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], np.zeros(3))
    rig_view = RigView("a", LENS, optical, np.ones((40, 60), np.float32))
    params = build(FusionParams, {"depth_std_m": 0.01, "max_depth_m": 5.0})
    range_m, std_m = range_from_depth(np.full((40, 60), 2.0, np.float32), rig_view, WHOLE, params)
    middle = np.isfinite(range_m)
    assert middle[16, 26:38].all()
    assert not middle[:, :20].any()
    v, u = np.nonzero(middle)
    rays = WHOLE.unproject(np.stack([u, v], axis=-1).astype(float))
    # a pixel of the sphere is 5.6 degrees wide and the nearest point counts: up to half a pixel of slope
    np.testing.assert_allclose(range_m[middle], 2.0 / rays[:, 0], rtol=0.1)
    np.testing.assert_allclose(std_m[middle], 0.01 * 4.0 * range_m[middle] / 2.0, rtol=0.02)
    beyond = range_from_depth(np.full((40, 60), 6.0, np.float32), rig_view, WHOLE, params)[0]
    assert np.isnan(beyond).all()


def test_gaps_are_filled_as_a_slope_goes_on():
    """Rings of a LiDAR on the ground: rows are known every eighth, the inverse range grows from row to row."""
    rows = np.arange(128, dtype=np.float32)[:, None] * np.ones((1, 256), np.float32) / 128
    known = np.zeros(rows.shape, np.bool_)
    known[4::8] = True
    found = fill(np.where(known, rows, np.float32(np.nan)), known)
    np.testing.assert_array_equal(found[known], rows[known])
    assert np.abs(found - rows)[16:-16].max() < 4.1 / 128  # no worse than the nearest ring
    assert np.abs(found - rows)[16:-16].mean() < 1.3 / 128  # and clearly better on average than its 2 rows


def test_filling_goes_on_around_the_seam():
    values = np.cos(np.linspace(0, 2 * np.pi, 256, endpoint=False)) * np.ones((128, 1))
    known = np.zeros((128, 256), np.bool_)
    known[:, 10:246] = True
    found = fill(values.astype(np.float32), known)
    assert np.abs(found[:, 0] - found[:, -1]).max() < 0.01
    assert np.abs(found - values).max() < 0.06  # 20 columns of a cosine are off its chord by 0.03


def test_a_cloud_is_sure_of_its_range_by_3_cm():
    range_m, std_m = range_from_cloud(np.array([[0.0, 5.0, 0.0]]), WHOLE)
    assert set(std_m[np.isfinite(range_m)].tolist()) == {np.float32(0.03)}
