"""Strips cover every pixel that two views share, and nothing but a band along the seams."""

import numpy as np

from sphere_mapping.acquisition.stitching.strips import strips_of

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
