"""Tiles of a view's block hold all that a sphere needs of it, once, and leave out the rest."""

from dataclasses import replace

import numpy as np
import pytest

from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.stitching.blending import blend
from sphere_mapping.acquisition.stitching.layouts import Layouts
from sphere_mapping.acquisition.stitching.strips import Block, Share, Strip
from sphere_mapping.acquisition.stitching.tiles import tiles_of
from sphere_nav.params import build
from worlds.rig import vertical_rig

STEP, WHOLE = 16, 256
BLOCK = Block(0, 192, 128, 128)  # around the seam of the columns


def covered(tiles, block=BLOCK):
    found = np.zeros((block.height, block.width), int)
    for tile in tiles:
        found[tile.row : tile.row + tile.height, tile.column : tile.column + tile.width] += 1
    return found


def tiles(is_owned=None, strips=(), view=1):
    nothing = np.zeros((BLOCK.height, BLOCK.width), np.uint8)
    return tiles_of(view, BLOCK, nothing if is_owned is None else is_owned, strips, STEP, WHOLE)


def test_what_a_strip_mixes_of_it_is_needed_and_what_it_takes_from_its_border():
    strip = Strip(Block(0, 160, 64, 96), (slice(0, 64), slice(0, 96)), (Share(1, slice(16, 64), ()),))
    found = covered(tiles(strips=(strip,)))  # columns 176 to 224 of the sphere: from 16 before the block on
    assert found[:64, :32].min() == 1
    assert found.sum() == 64 * 32
    # all of it before the block: its first column goes on
    before = replace(strip, shares=(Share(1, slice(0, 16), ()),))
    assert covered(tiles(strips=(before,))).sum() == 64 * STEP
    assert tiles(strips=(strip,), view=0) == ()


@pytest.fixture(scope="module")
def layout():
    layouts = Layouts(vertical_rig(), build(StitchParams, {"width": 1024}), {})
    return layouts.of("top", layouts.rig.names)


@pytest.mark.parametrize("has_range", [True, False])
def test_the_sphere_is_the_same_as_of_whole_blocks(layout, has_range, rng):
    images = {
        view.rig_view.name: rng.integers(90 + 5 * k, 110 + 5 * k, (160, 160, 3), np.uint8)
        for k, view in enumerate(layout.views)
    }
    inverse = rng.uniform(0.0, 1.0, (512, 1024)).astype(np.float32) if has_range else None
    blocks = [view.block for view in layout.views]
    whole = replace(layout, tiles=tuple((Block(0, 0, one.height, one.width),) for one in blocks))
    image = blend(layout, images, inverse)
    np.testing.assert_array_equal(image, blend(whole, images, inverse))
    needed = [covered(tiles, block) for tiles, block in zip(layout.tiles, blocks, strict=True)]
    assert max(one.max() for one in needed) == 1
    assert sum(one.sum() for one in needed) < 0.95 * sum(block.height * block.width for block in blocks)
