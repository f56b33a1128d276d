"""Several pairs of cameras that see one direction: what enough of them agree on is known."""

import numpy as np

from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.range.pairs import fuse_pairs
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_nav.geometry import SE3, Rig, RigCamera
from sphere_nav.params import build
from worlds.rig import LENS, OPTICAL, WIDTH

NAN, INF = np.nan, np.inf


def fuse(ranges, sees):
    """Return the range of one pixel by what pairs found there and whether they see it."""
    return fuse_pairs(column(sees), column(ranges), column([0.02 * min(r, 100.0) for r in ranges]))[0][0, 0]


def column(values):
    """Return planes of one pixel, one after the other."""
    found = np.array(values).reshape(-1, 1, 1)
    return found if found.dtype == np.bool_ else found.astype(np.float32)


def test_a_pair_that_alone_sees_a_direction_is_believed():
    assert fuse([3.0, NAN, NAN], [True, False, False]) == 3.0
    assert fuse([3.0, NAN], [True, True]) == 3.0


def test_one_of_three_pairs_is_not():
    assert np.isnan(fuse([3.0, NAN, NAN], [True, True, True]))
    np.testing.assert_allclose(fuse([3.0, 3.05, NAN], [True, True, True]), 3.025, rtol=0.01)


def test_pairs_that_agree_are_no_surer_than_the_surest_since_they_share_cameras():
    found = fuse_pairs(column([True] * 3), column([3.0] * 3), column([0.02, 0.02, 0.05]))
    assert found[1][0, 0] == np.float32(0.02)


def test_far_is_agreed_on_as_well():
    assert fuse([INF, INF, NAN, NAN], [True] * 4) == INF
    assert np.isnan(fuse([INF, NAN, NAN, NAN], [True] * 4))


def test_a_pair_sees_what_both_of_its_cameras_see():
    poses = [SE3.from_parts(OPTICAL, [0.0, y, 0.0]) for y in (0.15, -0.15)]
    rig = Rig(tuple(RigCamera(name, LENS, pose) for name, pose in zip("ab", poses, strict=True)))
    [pair] = Stitcher(rig, build(StitchParams, {"width": WIDTH})).stereo.pairs
    height = WIDTH // 2
    assert pair.sees.shape == (height, WIDTH)
    assert pair.sees[height // 2, WIDTH // 2]  # ahead
    assert not pair.sees[height // 2, 0]  # behind
    assert 0.15 < pair.sees.mean() < 0.5
