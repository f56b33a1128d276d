"""A wall all around, seen by two fisheyes whose lenses darken towards the rim, is one wall in the end."""

import numpy as np
import pytest

from sphere_mapping.acquisition.light.light import Falloff, Light, PairRatios, apply_gain, falloff
from sphere_mapping.acquisition.stitching.views import RigView, border_of
from sphere_nav.geometry import SE3, Fisheye, RigCamera
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

MAX_WHITE_BALANCE = 1.15

LENS = Fisheye(240, 240, 70.0, 70.0, 119.5, 119.5)
YAW = {"a": 0.0, "b": 1.2}  # rad; b looks to the left of a
RAYS = LENS.unproject(pixel_grid(LENS))
ANGLE = np.nan_to_num(np.arccos(np.clip(RAYS[..., 2], -1, 1)))


def rig_view(name, yaw, mask=None):
    T = SE3.exp([0, 0, 0, 0, 0, yaw]) @ T_BODY_OPTICAL
    return RigView(name, LENS, T, border_of(RigCamera(name, LENS, T), mask))


def picture(level=200.0, colors=(1.0, 1.0, 1.0)):
    gray = level * np.exp(-0.2 * ANGLE**2)
    return np.clip(np.rint(gray[..., None] * np.array(colors)), 0, 255).astype(np.uint8)


def light(masks=None, groups=None):
    views = [rig_view(name, yaw, (masks or {}).get(name)) for name, yaw in YAW.items()]
    return Light(views, groups or {name: name for name in YAW}, 0.0)


def test_lenses_that_darken_towards_the_rim_get_no_gain():
    """Half of b is masked, so that its rim looks where a's middle does: a median of all says 'b is dark'."""
    mask = np.full((240, 240), 255, np.uint8)
    mask[:, :130] = 0
    _, gains = light(masks={"b": mask}).balance({"a": picture(), "b": picture()})
    np.testing.assert_allclose(gains["a"] / gains["b"], 1.0, atol=0.03)


def test_the_falloff_is_taken_from_the_images():
    balance = light().balance
    images = {"a": picture(), "b": picture()}
    for _ in range(8):
        even, _ = balance(images)
    seen = (ANGLE < 1.5) & (RAYS[..., 0] < 0.9)
    before, after = (float(np.std(np.log(part["a"][seen].astype(float)))) for part in (images, even))
    assert before > 0.1
    assert after < 0.2 * before


def test_the_ratio_of_exposures_is_found_beside_the_falloff():
    _, gains = light().balance({"a": picture(), "b": picture(140.0)})
    np.testing.assert_allclose(gains["b"] / gains["a"], 200 / 140, rtol=0.02)


def test_cameras_of_one_exposure_have_one_gain():
    _, gains = light(groups={"a": "both", "b": "both"}).balance({"a": picture(), "b": picture()})
    np.testing.assert_allclose([gains["a"], gains["b"]], 1.0)


def test_a_color_departs_from_its_camera_by_the_bound_at_most():
    _, gains = light().balance({"a": picture(), "b": picture(colors=(1.0, 0.5, 1.0))})
    mean = np.log(2.0) / 6  # of the logarithms of three colours, half of it at either camera
    for gain in gains.values():
        assert np.ptp(np.log(gain)) == pytest.approx(mean + np.log(MAX_WHITE_BALANCE), rel=1e-2)


TRUE = np.array([-0.3, -0.1, -0.4])


def comparison(rng, exposures=(0.0, 0.25), lenses=(TRUE, TRUE), number=600, wrong=0.0, noise=0.02):
    """Pairs of angles all over two lenses; a share of the ratios is of two different things."""
    squares = rng.random((2, number))
    numbers = np.zeros(number, np.intp), np.ones(number, np.intp)
    ratio = exposures[0] - exposures[1] + falloff(lenses[0], squares[0]) - falloff(lenses[1], squares[1])
    ratio = ratio + rng.normal(0, noise, number)
    is_wrong = rng.random(number) < wrong
    ratio[is_wrong] += rng.exponential(1.0, np.count_nonzero(is_wrong))
    return PairRatios(numbers, numbers, (squares[0], squares[1]), ratio)


def test_falloff_and_exposures_are_found_though_a_third_is_wrong(rng):
    found = Falloff(2)
    seen = [comparison(rng, wrong=0.3) for _ in range(8)]
    for one in seen:
        found.update(one, 2)
    at = np.linspace(0, 1, 9)
    for coefficients in found.coefficients:
        np.testing.assert_allclose(falloff(coefficients, at), falloff(TRUE, at), atol=0.05)
    np.testing.assert_allclose(np.diff(found.exposures(seen[0], 2)), 0.25, atol=0.05)


def test_a_gain_multiplies_and_white_stays_white():
    image = np.arange(256, dtype=np.uint8).reshape(16, 16)
    darker = apply_gain(image, np.array([0.5])).astype(int)
    np.testing.assert_array_equal(darker.flat[:246], np.rint(0.5 * np.arange(246)).astype(int))
    assert darker.flat[255] == 255
    assert np.all(np.diff(darker.ravel()) >= 0)
    assert apply_gain(image, np.array([3.0])).flat[100] == 255
