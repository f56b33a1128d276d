"""Strips cover every pixel that two views share, and nothing but a band along the seams."""

import numpy as np

from sphere_mapping.acquisition.stitching.strips import Block, block_around, strips_of

WIDTH, HEIGHT = 1024, 512


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
        rows, columns = (np.arange(2 * WIDTH)[part] % WIDTH for part in strip.shown.slices())
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


def test_a_block_holds_what_is_wanted_round_the_back():
    is_wanted = np.zeros((32, 64), bool)
    assert block_around(is_wanted) is None
    is_wanted[10:14, [62, 63, 0, 1]] = True
    assert block_around(is_wanted) == Block(10, 62, 4, 4)
    assert block_around(is_wanted).cut(is_wanted).all()
    is_wanted[:] = True
    block = block_around(is_wanted)
    assert (block.row, block.height, block.width) == (0, 32, 64)
