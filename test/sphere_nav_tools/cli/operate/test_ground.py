"""The ground of a map as a picture: where what was seen lies, gaps, what nobody saw."""

import numpy as np

from sphere_nav_tools.cli.operate.ground import add_colors, closed


def test_a_cell_has_the_mean_of_what_was_seen_there():
    sums = np.zeros((4, 4))
    add_colors(sums, np.array([2, 2, 3]), np.array([[10, 20, 30], [30, 40, 50], [7, 7, 7]], np.uint8))
    add_colors(sums, np.array([0]), np.array([9], np.uint8))  # grey
    assert sums.tolist() == [[9, 9, 9, 1], [0, 0, 0, 0], [40, 60, 80, 2], [7, 7, 7, 1]]


def test_small_gaps_take_the_colour_beside_them_and_the_unseen_is_clear():
    picture = np.zeros((40, 40, 4))
    picture[5:20, 5:20] = (200, 100, 50, 1)
    picture[12, 12] = 0
    found = closed(picture)
    np.testing.assert_allclose(found[12, 12], (200, 100, 50, 255), atol=2)
    assert found[35, 35, 3] == 0
