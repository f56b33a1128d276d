"""Light that varies over the view: that it is there, and by how much it biases a pose."""

from dataclasses import replace

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.photometric import RegistrationParams, build_pyramid, register
from sphere_nav.photometric.align.judgement import Alignment
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.checks.illumination import find_illumination_bias
from sphere_nav.photometric.checks.structure import find_rig_structure
from sphere_nav.photometric.pixels.samples import Sample
from worlds.room import BESIDE, soft_room, structure_of, views_of

PARAMS = RegistrationParams(max_pixels=10_000, max_mad=100.0)
CAMERA = Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5)


@pytest.fixture(scope="module")
def soft():
    return soft_room(21)


@pytest.fixture(scope="module")
def views(soft):
    return views_of(soft, PARAMS)


def shine(image, slope):
    """Return an image in light that falls from one side to the other."""
    ramp = np.exp(np.linspace(-slope, slope, image.shape[1]))
    return np.clip(np.rint(image * ramp), 1, 255).astype(np.uint8)


def aligned(soft, views, slope):
    pyramid = build_pyramid(shine(soft.photograph(CAMERA, BESIDE, 1), slope), CAMERA, PARAMS.pyramid)
    return pyramid, register(pyramid, views, BESIDE, PARAMS)


@pytest.mark.parametrize("slope", [-0.2, -0.4])
def test_what_uneven_light_pulls_is_found(soft, views, slope):
    pyramid, found = aligned(soft, views, slope)
    off = (found.T_world_camera.inverse() @ BESIDE).log()
    bias = structure_of(pyramid, views, found, PARAMS).illumination
    assert np.linalg.norm(off[:3]) > 0.02  # or there is nothing to find
    assert bias.share > 0.3
    # half of it and more, the right way: what pulls by decimetres is at home in the coarse levels, this is the finest
    assert 0.4 < bias.xi @ off / (off @ off) < 1.2
    assert bias.xi @ off > 0.8 * np.linalg.norm(bias.xi) * np.linalg.norm(off)


def test_the_pull_of_cameras_on_a_body_is_that_of_the_body(soft, views):
    place = SE3.exp([0.2, -0.1, 0.3, 0.1, 0.4, -0.2])
    pyramid, found = aligned(soft, views, 0.4)
    # twice: on the way pixels may be chosen anew, and stay chosen for the next call
    _, alone = (structure_of(pyramid, views, found, PARAMS).illumination for _ in range(2))
    image = RigImage(pyramid, place, tuple(views))
    body = Alignment(**{**vars(found), "T_world_camera": found.T_world_camera @ place.inverse()})
    there = find_rig_structure([image], body, PARAMS).illumination
    assert there.share == pytest.approx(alone.share, abs=1e-3)
    np.testing.assert_allclose(there.xi, place.adjoint() @ alone.xi, atol=2e-4)


def samples_of(shape, noise, number=2000):
    """Return pixels that err by a gain with a shape over the image (at -> 1), 10 grey levels of it, and by noise."""
    rng = np.random.default_rng(4)
    points, gradients = rng.normal([0.0, 0.0, 4.0], 1.0, (number, 3)), rng.normal(0.0, 50.0, (number, 3))
    at, current = rng.uniform(-1.0, 1.0, (number, 2)), np.full(number, 100.0)
    residual = 10.0 * shape(at) + rng.normal(0.0, noise, number)
    view, zeros = np.zeros(number, np.int64), np.zeros(number)
    return [(SE3.identity(), Sample(view, points, gradients, gradients, zeros, current, residual, at))]


def wave(half_periods):
    return lambda at: np.cos(half_periods * 0.5 * np.pi * (at[:, 0] + 1.0))


def bias_of(cameras):
    """Return the bias, and how often pixels were sampled anew."""
    calls = []
    found = find_illumination_bias(lambda T: calls.append(T) or cameras, cameras, SE3.identity(), PARAMS)
    return found, len(calls)


def test_a_gain_of_up_to_two_half_periods_is_a_gradient():
    shares = [bias_of(samples_of(wave(k), 3.0))[0].share for k in (1, 2, 3)]
    assert min(shares[:2]) > 0.8
    assert shares[2] < 0.1


def test_a_fifth_of_the_squares_is_a_gradient():
    for share, is_gradient in [(0.15, False), (0.25, True)]:
        found, calls = bias_of(samples_of(wave(1), np.sqrt(50.0 * (1.0 - share) / share)))
        assert found.share == pytest.approx(share, abs=0.04)  # weights favour what is explained
        assert (calls > 0) == is_gradient


def test_steps_end_at_a_tenth_of_the_bias_and_after_six():
    """The first step is 1 m, each later one a share of it: the third ends it if 0.12 < 0.1 (1 + 2 * 0.12)."""
    for share, calls in [(0.99, 6), (0.12, 3), (0.105, 2)]:
        ((place, sample),) = problem = samples_of(wave(1), 1.0)
        steps = []

        def sampler(_, share=share, steps=steps, place=place, sample=sample):
            steps.append(share if steps else 1.0)
            return [(place, replace(sample, residual=-sample.by_pose @ [steps[-1], 0.0, 0.0, 0.0, 0.0, 0.0]))]

        find_illumination_bias(sampler, problem, SE3.identity(), PARAMS)
        assert len(steps) == calls
