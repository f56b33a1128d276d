"""Several drives count together."""

import numpy as np

from dense_localizer.references.rejections import Rejections
from sphere_nav.offline.forgetting import together

# Written out: imported, a change would go unseen.
SQUARE_COLUMNS, SQUARE_ROWS = 64, 32


def counts(number):
    return np.full((2, SQUARE_ROWS, SQUARE_COLUMNS), number, np.int64)


def test_drives_that_saw_the_same_spheres_are_added():
    found = together([Rejections({0: counts(3), 1: counts(2)}), Rejections({1: counts(5)})]).counts
    assert {sphere_id: count.max() for sphere_id, count in found.items()} == {0: 3, 1: 7}
    assert found[1].min() == 7
