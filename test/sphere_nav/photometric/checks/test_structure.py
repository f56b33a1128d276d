"""What residuals say of an alignment: gradients of another place, a rolling shutter, how likely a place is, a bias."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sphere_nav.geometry import SE3, FrameMotion, Pinhole
from sphere_nav.photometric import RegistrationParams, build_pyramid, register
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.checks.structure import (
    NO_SUPPORT,
    Aspect,
    find_rig_structure,
    linearize_samples,
    solve_robustly,
)
from sphere_nav.photometric.pixels.samples import Sample
from worlds.room import BESIDE, structure_of, views_of

PARAMS = RegistrationParams(max_pixels=10_000)
CAMERA = Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5)


@pytest.fixture(scope="module")
def views(room):
    return views_of(room, PARAMS)


def test_gradients_of_another_place_do_not_agree(room, views):
    elsewhere = SE3.exp([1.0, 0.5, -0.5, 0.3, 2.0, 0.1])
    pyramid = build_pyramid(room.photograph(CAMERA, elsewhere, 1), CAMERA, PARAMS.pyramid)
    alignment = register(pyramid, views, BESIDE, replace(PARAMS, max_mad=1e3))
    assert structure_of(pyramid, views, alignment, PARAMS).agreement < 0.2


def test_the_gradients_of_a_rolling_shutter_agree_when_its_motion_is_known(room, views):
    twist = np.array([0.02, 0.0, 0.03, 0.0, 0.02, 0.0])
    image = np.rint(room.render_rolling(CAMERA, BESIDE, twist)).astype(np.uint8)
    motion = FrameMotion(BESIDE @ SE3.exp(-twist), 1.0)
    pyramid = build_pyramid(image, CAMERA, PARAMS.pyramid)
    alignment = register(pyramid, views, BESIDE, PARAMS, motion)
    found = structure_of(pyramid, views, alignment, PARAMS, motion)
    assert found.agreement > structure_of(pyramid, views, alignment, PARAMS).agreement


def test_how_likely_a_place_is_is_asked_of_a_good_alignment_too_and_moves_no_pose(room, views):
    pyramid = build_pyramid(room.photograph(CAMERA, BESIDE, 1), CAMERA, PARAMS.pyramid)
    alignment = register(pyramid, views, BESIDE, PARAMS)
    seen = [RigImage(pyramid, views=tuple(views))]
    place, fit = (find_rig_structure(seen, alignment, PARAMS, aspects=one) for one in (Aspect.PLACE, Aspect.FIT))
    assert place.chance < 1e-7 < fit.chance == 1.0
    assert place.support is fit.support is NO_SUPPORT
    wrong = replace(alignment, T_world_camera=BESIDE @ SE3.exp([0.5, 0.2, 0.0, 0.0, 0.3, 0.0]))
    assert find_rig_structure(seen, wrong, PARAMS, aspects=Aspect.PLACE).chance > 0.01


STEP = np.array([0.01, -0.02, 0.03, 0.004, -0.005, 0.006])


def sample_of(rng, num_views=1, number=400):
    """Pixels whose residuals are those of a step of the pose, of a gain and a bias."""
    view, number = np.repeat(np.arange(num_views), number), num_views * number
    points, gradients = rng.normal([0.0, 0.0, 4.0], 1.0, (number, 3)), rng.normal(0.0, 50.0, (number, 3))
    current, at = rng.uniform(50.0, 200.0, number), rng.uniform(-1.0, 1.0, (number, 2))
    by_point, zeros = np.zeros((number, 2, 3)), np.zeros(number)
    sample = Sample(view, points, zeros, by_point, gradients, gradients, zeros, current, zeros, at)
    light = 0.1 * current - 3.0
    return Sample(**{**vars(sample), "residual": -sample.by_pose @ STEP - light})


def test_the_step_of_the_pose_is_told_from_light_and_outliers():
    rng = np.random.default_rng(1)
    sample = sample_of(rng, 2)
    sample.residual[:40] += 100.0
    x, left, weight = solve_robustly(*linearize_samples(sample))
    assert x.shape == (6 + 2 * 2,)
    np.testing.assert_allclose(x[:6], STEP, atol=2e-3)
    np.testing.assert_allclose(x[6::2], 0.1, atol=2e-3)
    np.testing.assert_allclose(x[7::2], -3.0, atol=0.3)
    assert np.median(np.abs(left)) < 0.1
    assert np.max(weight[:40]) < 0.1 * np.median(weight)
