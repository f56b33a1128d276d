"""Overlap is the covered share of the image."""

import numpy as np

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.photometric import PyramidParams, RegistrationParams, View, build_pyramid, prepare_reference
from sphere_nav.photometric.align.rig import image_overlap

CAMERA = Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5)
PARAMS = RegistrationParams(pyramid=PyramidParams(num_levels=2, min_side=8))


def overlap(range_m, turn=0.0):
    image = np.zeros((120, 160), np.uint8)
    view = View(prepare_reference(image, range_m, CAMERA, PARAMS), SE3.identity())
    return image_overlap(build_pyramid(image, CAMERA, PARAMS.pyramid), [view], SE3.exp([0, 0, 0, 0, turn, 0]))


def test_the_same_view_covers_all_but_its_border():
    assert overlap(np.full((120, 160), 3.0, np.float32)) > 0.95


def test_half_the_range_covers_half():
    range_m = np.full((120, 160), 3.0, np.float32)
    range_m[:, 80:] = np.nan
    assert abs(overlap(range_m) - 0.5) < 0.05


def test_turning_away_uncovers_what_comes_into_view():
    half_fov = np.arctan(80 / 110)
    covered = overlap(np.full((120, 160), 3.0, np.float32), turn=half_fov)
    assert 0.35 < covered < 0.6
    assert overlap(np.full((120, 160), 3.0, np.float32), turn=np.pi) == 0.0
