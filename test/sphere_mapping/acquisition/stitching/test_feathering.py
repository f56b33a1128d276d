"""Two half spheres of different brightness meet at their seams, and keep their own far from them."""

import numpy as np
import pytest

from sphere_mapping.acquisition.stitching.feathering import feather, seams_of
from sphere_mapping.acquisition.stitching.strips import Block

WIDTH, HEIGHT, STEP = 1024, 512, 8
WHOLE = Block(0, 0, HEIGHT, WIDTH)
TILES = [[WHOLE], [Block(0, 0, HEIGHT, WIDTH // 2), Block(0, WIDTH // 2, HEIGHT, WIDTH // 2)]]


@pytest.fixture
def seams():
    owner = np.zeros((HEIGHT, WIDTH), np.int8)
    owner[:, WIDTH // 2 :] = 1
    return seams_of(owner, [np.ones((HEIGHT // STEP, WIDTH // STEP), np.bool_)] * 2, STEP)


def walls(first, second, channels=3):
    shape = (HEIGHT, WIDTH, 3) if channels == 3 else (HEIGHT, WIDTH)
    return [np.full(shape, level, np.uint8) for level in (first, second)]


@pytest.mark.parametrize("channels", [1, 3])
def test_light_meets_at_the_seam_and_is_kept_far_from_it(seams, channels):
    first, second = parts = walls(150, 165, channels)
    feather(parts, [WHOLE, WHOLE], seams, STEP, TILES)
    row = HEIGHT // 2
    for seam in (0, WIDTH // 2):  # one of them where the columns wrap around
        step = np.abs(first[row, seam].astype(float) - second[row, seam]).max()
        assert step < 4  # of 15
    for part, level in ((first, 150), (second, 165)):
        assert np.abs(part[row, WIDTH // 4].astype(float) - level).max() <= 1
        assert np.abs(part[row, -1].astype(float) - part[row, 0]).max() <= 1


def test_what_differs_too_much_to_be_light_is_left_alone(seams):
    parts = walls(60, 200)
    feather(parts, [WHOLE, WHOLE], seams, STEP, TILES)
    np.testing.assert_array_equal(parts, walls(60, 200))
