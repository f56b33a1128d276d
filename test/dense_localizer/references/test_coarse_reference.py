"""What is kept of a key sphere: its window, its median range; what alignment needs is made again."""

from __future__ import annotations

import numpy as np
import pytest

from dense_localizer.references.coarse_reference import CoarseReferences
from sphere_nav.geometry import Spherical
from sphere_nav.photometric import RegistrationParams
from sphere_nav.spheres.sphere import Sphere

CAMERA, PARAMS = Spherical(128, 64), RegistrationParams()
FORWARD_STEP = 0.2


def sphere_of(range_m):
    gray = np.random.default_rng(0).uniform(0, 255, (CAMERA.height, CAMERA.width)).astype(np.uint8)
    return Sphere(gray, np.full(gray.shape, range_m, np.float32), CAMERA)


def test_the_median_range_tells_how_far_before_and_behind_a_camera_is_looked_for():
    references = CoarseReferences({0: sphere_of(4.0), 1: sphere_of(np.inf)}, PARAMS)
    near, bare = references[0], references[1]
    assert (near.typical_range_m, near.step_m) == (4.0, pytest.approx(FORWARD_STEP * 4.0))
    assert (bare.typical_range_m, bare.step_m) == (np.inf, 0.0)


def test_a_sphere_is_read_when_it_is_first_needed_and_made_again_when_so_many_others_were_made_since():
    read = []

    class Spheres(dict):
        def __missing__(self, sphere_id):
            read.append(sphere_id)
            return sphere_of(2.0 + sphere_id)

    references = CoarseReferences(Spheres(), PARAMS)
    assert references[1].typical_range_m == pytest.approx(3.0)
    first = references.reference(1)
    assert references.reference(1) is first
    for other in range(2, 2 + 32):
        assert set(read) == set(range(1, other))
        references.reference(other)
    assert references.reference(1) is not first
