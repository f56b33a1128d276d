"""Cameras of several models in a ring within a textured sphere: range by all that see a direction, or none."""

import numpy as np
import pytest

from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.stitching.stitcher import Stitcher
from sphere_nav.geometry import SE3, DoubleSphere, Fisheye, Rig, RigCamera
from sphere_nav.params import build
from worlds.rig import LENS, OPTICAL, WIDTH, seen, truth

OTHER = DoubleSphere(160, 160, 44.0, 44.0, 79.5, 79.5, 0.3, 0.55)
BENT = Fisheye(160, 150, 46.0, 47.0, 80.5, 74.5, (-0.02, 0.002, 0.0, 0.0))
PARAMS = build(StitchParams, {"width": WIDTH, "match.noise": 0.5})


@pytest.fixture(scope="module")
def ring():
    parts = []
    for k in range(6):
        pose = SE3.from_planar(0.0, 0.0, k * np.pi / 3) @ SE3.from_parts(OPTICAL, [0.3, 0.0, 0.0])
        parts.append(RigCamera(f"c{k}", (LENS, OTHER, BENT)[k % 3], pose))
    return Rig(tuple(parts))


@pytest.fixture(scope="module")
def images(ring):
    return {part.name: seen(part) for part in ring.cameras}


@pytest.fixture(scope="module")
def stitcher(ring):
    return Stitcher(ring, PARAMS)


@pytest.fixture(scope="module")
def found(stitcher, images):
    return stitcher.stereo.find(images)[0]


def test_range_is_that_of_the_scene_and_so_is_its_deviation(stitcher, found):
    range_m, std_m = found
    _, expected = truth(stitcher)
    known = np.isfinite(range_m)
    middle = np.abs(np.arange(WIDTH // 2) - WIDTH / 4) < WIDTH / 8  # within 45 degrees of the horizon
    assert known[middle].mean() > 0.6
    error = np.abs(range_m - expected)[known]
    assert np.median(error / expected[known]) < 0.015
    assert np.mean(error > 3 * std_m[known]) < 0.02
    assert (std_m[known] <= 0.08 * range_m[known] * 1.001).all()
