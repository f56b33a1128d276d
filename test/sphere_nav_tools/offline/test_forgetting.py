"""Several drives count together."""

import numpy as np

from dense_localizer.references.rejections import Rejections
from sphere_nav.geometry import Spherical
from sphere_nav.spheres.sphere import Sphere
from sphere_nav_tools.offline.forgetting import together, without

# Written out: imported, a change would go unseen.
SQUARE_COLUMNS, SQUARE_ROWS = 64, 32


def counts(number):
    return np.full((2, SQUARE_ROWS, SQUARE_COLUMNS), number, np.int64)


def test_drives_that_saw_the_same_spheres_are_added():
    found = together([Rejections({0: counts(3), 1: counts(2)}), Rejections({1: counts(5)})]).counts
    assert {sphere_id: count.max() for sphere_id, count in found.items()} == {0: 3, 1: 7}
    assert found[1].min() == 7


def test_what_is_forgotten_has_no_range():
    count = counts(0)
    count[0], count[1, 5:7, 60:] = 10, 10
    shape = (SQUARE_ROWS, SQUARE_COLUMNS)
    image, range_m = np.full(shape, 7, np.uint8), np.full(shape, 3.0, np.float32)
    std_m = np.full(shape, 0.1, np.float32)
    sphere = Sphere(image, range_m, Spherical(SQUARE_COLUMNS, SQUARE_ROWS), range_std_m=std_m, is_filled=image > 0)
    found = without(sphere, Rejections({3: count}), 3)
    is_gone = np.zeros(shape, bool)
    is_gone[5:7, 60:] = True
    np.testing.assert_array_equal(np.isnan(found.range_m), is_gone)
    np.testing.assert_array_equal(np.isnan(found.range_std_m), is_gone)
    np.testing.assert_array_equal(found.is_filled, ~is_gone)
    np.testing.assert_array_equal(found.range_m[~is_gone], 3.0)
    np.testing.assert_array_equal(found.range_std_m[~is_gone], np.float32(0.1))
    assert without(sphere, Rejections({3: count}), 4) is sphere
