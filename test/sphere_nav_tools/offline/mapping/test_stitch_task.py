"""Instants stitched with what another stitcher has learned have the same bits."""

import pickle

import numpy as np
import pytest

pytest.importorskip("rclpy")

from sphere_mapping.acquisition import kernels
from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_nav.params import build
from sphere_nav_tools.offline.mapping.stitcher_ahead import LearnedRig
from worlds.rig import WIDTH, seen, vertical_rig

pytestmark = pytest.mark.slow

# Written out: imported, a change would go unseen.
NUM_INSTANTS = 8


def test_an_instant_is_stitched_elsewhere_as_by_the_stitcher_that_has_learned_its_rig():
    kernels.warm_up()
    stitcher = Stitcher(vertical_rig(), build(StitchParams, {"width": WIDTH}))

    def images(phase):
        return {part.name: seen(part, phase) for part in stitcher.rig.cameras}

    with pytest.raises(ValueError, match="expected a stitcher that has learned it, found one that learns"):
        LearnedRig.of(stitcher)
    for number in range(NUM_INSTANTS):
        assert not stitcher.is_settled
        stitcher.stitch(images(0.1 * number), number)
    assert stitcher.is_settled
    dark = {name: (image // 2 if "left" in name else image) for name, image in images(1.0).items()}
    there = pickle.loads(pickle.dumps(LearnedRig.of(stitcher))).stitcher().stitch(dark, 99).sphere
    here = stitcher.stitch(dark, 99).sphere
    assert there.stamp_ns == here.stamp_ns == 99
    for one, other in ((there.image, here.image), (there.range_m, here.range_m), (there.range_std_m, here.range_std_m)):
        np.testing.assert_array_equal(one, other)
