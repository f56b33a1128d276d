"""The block of the sphere that a camera needs: round the back, with a margin, aligned; and the rays of its pixels."""

import numpy as np

from sphere_mapping.acquisition.stitching.strips import Block
from sphere_mapping.acquisition.stitching.views import block_around, block_rays
from sphere_nav.geometry import Spherical

WHOLE = Spherical(256, 128)


def test_a_block_holds_what_is_wanted_with_a_margin_aligned_and_round_the_back():
    is_wanted = np.zeros((32, 64), bool)  # every fourth pixel
    assert block_around(is_wanted, WHOLE, 4, 8, 16) is None
    is_wanted[10:14, [62, 63, 0, 1]] = True
    assert block_around(is_wanted, WHOLE, 4, 8, 16) == Block(16, 224, 64, 64)  # 28 to 68, 236 to 276
    is_wanted[:] = True
    assert block_around(is_wanted, WHOLE, 4, 8, 16) == Block(0, 240, 128, 272)  # all, and a margin twice


def test_rays_are_those_of_the_pixels_and_of_one_more_at_the_end():
    block = Block(16, 224, 48, 64)
    rays = block_rays(WHOLE, block, 5)
    assert rays.shape == (11, 14, 3)
    np.testing.assert_allclose(rays[3, 13], WHOLE.unproject([224 + 65, 16 + 15]), atol=1e-12)
    assert block_rays(WHOLE, block).shape == (48, 64, 3)
