"""After the warm-up no image of a rig waits for a kernel."""

import numpy as np
import pytest

from sphere_mapping.acquisition import kernels
from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.range import kernels as range_kernels
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_mapping.acquisition.warm_up import warm_up
from sphere_nav.params import build
from worlds.rig import LENS, WIDTH, vertical_rig

pytestmark = pytest.mark.slow


def signatures():
    every = [*vars(kernels).values(), *vars(range_kernels).values()]
    return {kernel.__name__: len(kernel.signatures) for kernel in every if hasattr(kernel, "signatures")}


def test_a_rig_of_another_size_uses_what_is_compiled():
    warm_up()
    compiled = signatures()
    assert compiled["cost_ratios"] == compiled["sweep"] == 1
    stitcher = Stitcher(vertical_rig(), build(StitchParams, {"width": WIDTH}))
    stitcher.stitch({name: np.full((LENS.height, LENS.width), 90, np.uint8) for name in stitcher.rig.names})
    assert signatures() == compiled
