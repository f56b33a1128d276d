"""Strips cover every pixel that two views share, and nothing but a band along the seams."""

import numpy as np

from sphere_mapping.acquisition.stitching.strips import Block, strips_of
from sphere_mapping.acquisition.stitching.views import block_around, block_rays
from sphere_nav.geometry import Spherical

WIDTH, HEIGHT = 1024, 512
SPHERE = Spherical(256, 128)


def owner_of(edges):
    """Views side by side; edges: first columns."""
    owner = np.zeros((HEIGHT, WIDTH), np.int8)
    for number, first in enumerate(edges):
        owner[:, first:] = number
    owner[:, : edges[0]] = len(edges) - 1
    return owner


def covered(strips):
    found = np.zeros((HEIGHT, WIDTH), int)
    for strip in strips:
        rows = strip.block.row + np.arange(HEIGHT * 2)[strip.inner[0]]
        columns = (strip.block.column + np.arange(WIDTH * 2)[strip.inner[1]]) % WIDTH
        found[np.ix_(rows, columns)] += 1
    return found


def test_seams_lie_in_strips_that_do_not_overlap_and_whose_shares_make_one():
    found = covered(strips_of(owner_of((100, 500, 900)), 3, 4))
    assert found.max() == 1
    for first in (100, 500, 900):
        assert found[:, (first - 20) % WIDTH : (first - 20) % WIDTH + 1].all()
        assert found[:, (first + 20) % WIDTH].all()
    assert found.mean() < 0.6  # most of the sphere is one camera's
    for strip in strips_of(owner_of((100, 500, 900)), 3, 4):
        for level in range(5):
            total = np.zeros((strip.block.height >> level, strip.block.width >> level))
            for share in strip.shares:
                total[:, share.columns.start >> level : share.columns.stop >> level] += share.weights[level]
            np.testing.assert_allclose(total, 1.0, atol=1e-5)


def test_a_block_knows_where_another_one_lies_round_the_back_and_repeats_its_border_beyond():
    rows, columns = Block(10, 1000, 20, 40).places_of(Block(8, 990, 24, 60), WIDTH)
    assert rows.tolist() == [0, 0, *range(20), 19, 19]
    assert columns.tolist() == [0] * 10 + [*range(40)] + [39] * 10


def test_a_block_holds_what_is_wanted_with_a_margin_aligned_and_round_the_back():
    is_wanted = np.zeros((32, 64), bool)  # every fourth pixel
    assert block_around(is_wanted, SPHERE, 4, 8, 16) is None
    is_wanted[10:14, [62, 63, 0, 1]] = True
    assert block_around(is_wanted, SPHERE, 4, 8, 16) == Block(16, 224, 64, 64)  # 28 to 68, 236 to 276
    is_wanted[:] = True
    assert block_around(is_wanted, SPHERE, 4, 8, 16) == Block(0, 240, 128, 256)  # all


def test_rays_are_those_of_the_pixels():
    block = Block(16, 224, 48, 64)
    rays = block_rays(SPHERE, block, 5)
    assert rays.shape == (10, 13, 3)
    np.testing.assert_allclose(rays[3, 12], SPHERE.unproject([224 + 60, 16 + 15]), atol=1e-12)
    assert block_rays(SPHERE, block).shape == (48, 64, 3)
