import numpy as np

from sphere_mapping.acquisition.partial.joining import Patch, exposure_gains, join_views
from sphere_nav.geometry import Spherical

WHOLE = Spherical(128, 64)


def patch(first_column, gain=1.0, width=48, color=False, range_value=2.0):
    """A band of a sphere whose grey level depends on the column alone, at another exposure."""
    columns = (np.arange(width) + first_column) % WHOLE.width
    row = gain * (100 + 40 * np.sin(2 * np.pi * columns / WHOLE.width))
    image = np.repeat(np.rint(row)[None, :], 32, axis=0).astype(np.uint8)
    image = np.repeat(image[..., None], 3, axis=2) if color else image
    border = np.minimum(np.arange(width), width - 1 - np.arange(width)) + 0.5
    weight = np.repeat(border[None, :], 32, axis=0).astype(np.float32)
    range_m = np.full((32, width), range_value, np.float32)
    return Patch(image, range_m, weight, Spherical(width, 32, 128.0, float(first_column), 16.0))


def ring(**options):
    return [patch(column, **options) for column in (0, 32, 64, 96)]


def test_different_exposures_are_made_equal():
    patches = [patch(column, gain) for column, gain in zip((0, 32, 64, 96), (1.0, 1.3, 0.7, 0.9), strict=True)]
    gains = exposure_gains(patches, WHOLE) * np.array([1.0, 1.3, 0.7, 0.9])
    np.testing.assert_allclose(gains / gains[0], 1.0, atol=0.01)


def test_where_one_camera_measures_no_depth_that_of_another_is_kept():
    blind, other = patch(0, range_value=np.nan), patch(16, range_value=3.0)
    _, range_m = join_views([blind, other], WHOLE)
    assert np.all(range_m[16:48, 16:64] == 3.0)


def test_a_closed_ring_has_no_seam_and_no_hole():
    for color in (False, True):
        image, range_m = join_views(ring(color=color), WHOLE)
        band = image[16:48].astype(int).reshape(32, 128, -1)
        assert np.isfinite(range_m[16:48]).all()
        steps = np.abs(np.diff(np.concatenate([band, band[:, :1]], axis=1), axis=1))
        assert steps.max() <= 3  # 40 levels over 128 columns rise by 2 a column
        assert not image[:16].any()
        assert np.isnan(range_m[:16]).all()
