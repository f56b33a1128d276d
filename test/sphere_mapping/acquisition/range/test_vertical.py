"""Range between two levels; the whole way is tested in stitching/test_stitcher.py."""

import numpy as np
import pytest

from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.range.vertical import VerticalStereo
from sphere_mapping.acquisition.stitching.layouts import Layouts
from sphere_nav.params import build
from worlds.rig import RADIUS, WIDTH, seen, vertical_rig


@pytest.fixture(scope="module")
def stereo():
    params = build(StitchParams, {"width": WIDTH})
    return VerticalStereo(Layouts(vertical_rig(), params, {}), params, jobs=1)


@pytest.fixture(scope="module")
def grays():
    return {part.name: seen(part) for part in vertical_rig().cameras}


def test_range_is_that_of_the_scene_and_the_order_is_checked_once(stereo, grays):
    assert not stereo.is_checked
    found = stereo.find(grays)
    assert stereo.is_checked
    [(range_m, std_m)] = found
    measured = np.isfinite(range_m)
    assert measured.mean() > 0.5
    assert np.isfinite(std_m[measured]).all()
    assert np.median(range_m[measured]) == pytest.approx(RADIUS, rel=0.05)
