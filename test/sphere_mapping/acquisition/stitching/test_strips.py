"""Strips cover what views share; tiles of a view hold all that a sphere needs of it, once, and leave out the rest."""

from dataclasses import replace

import numpy as np
import pytest

from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.stitching.blending import blend
from sphere_mapping.acquisition.stitching.layouts import Layouts
from sphere_mapping.acquisition.stitching.strips import Block, Share, Strip, strips_of, tiles_of
from sphere_nav.params import build
from worlds.rig import vertical_rig

STEP, SMALL = 16, (128, 256)


def drawn(tiles, shape=SMALL):
    found = np.zeros(shape, int)
    for tile in tiles:
        found[tile.slices()] += 1
    return found


def test_what_a_strip_mixes_of_it_is_needed_and_what_it_shows():
    nothing = np.zeros(SMALL, bool)
    block = Block(0, -32, 64, 96)  # around the seam of the columns
    strip = Strip(block, block, (Share(1, slice(16, 64), ()),))
    found = drawn(tiles_of(1, nothing, [strip], STEP))  # columns 240 to 288 of the sphere
    assert found[:64, :32].min() == found[:64, 240:].min() == 1
    assert found.sum() == 64 * 48
    assert not list(tiles_of(0, nothing, [strip], STEP))
    nothing[100, 100] = True
    assert drawn(tiles_of(0, nothing, [strip], STEP)).sum() == 64 * STEP  # cells of four rows


@pytest.fixture(scope="module")
def layout():
    layouts = Layouts(vertical_rig(), build(StitchParams, {"width": 1024}), {})
    return layouts.of("top", layouts.rig.names)


@pytest.mark.parametrize("has_range", [True, False])
def test_the_sphere_is_the_same_as_of_whole_views(layout, has_range, rng):
    images = {
        view.rig_view.name: rng.integers(90 + 5 * k, 110 + 5 * k, (160, 160, 3), np.uint8)
        for k, view in enumerate(layout.views)
    }
    inverse = rng.uniform(0.0, 1.0, (512, 1024)).astype(np.float32) if has_range else None
    image = blend(layout, images, inverse)
    if has_range:
        everything = (Block(0, 0, 512, 1024),)
        views = tuple(replace(view, tiles=everything, tables=view.tables[:1]) for view in layout.views)
        np.testing.assert_array_equal(image, blend(replace(layout, views=views), images, inverse))
    needed = [drawn(view.tiles, image.shape[:2]) for view in layout.views]
    assert max(one.max() for one in needed) == 1
    assert sum(one.mean() for one in needed) < 2.0
    shown = [one[view.is_owned > 0] for one, view in zip(needed, layout.views, strict=True)]
    assert all(one.all() for one in shown)


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
