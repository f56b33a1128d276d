"""A wall all around, seen by two fisheyes whose lenses darken towards the rim, is one wall in the end."""

import numpy as np
import pytest

from sphere_mapping.acquisition.light.light import Light
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


def picture(level=200.0, falloff=0.2, colors=(1.0, 1.0, 1.0)):
    gray = level * np.exp(-falloff * ANGLE**2)
    return np.clip(np.rint(gray[..., None] * np.array(colors)), 0, 255).astype(np.uint8)


def light(yaws=YAW, masks=None, groups=None):
    views = [rig_view(name, yaw, (masks or {}).get(name)) for name, yaw in yaws.items()]
    return Light(views, groups or {name: name for name in yaws}, 0.0, 3.0)


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


def test_a_color_departs_from_its_camera_by_the_bound_at_most():
    _, gains = light().balance({"a": picture(), "b": picture(colors=(1.0, 0.5, 1.0))})
    mean = np.log(2.0) / 6  # of the logarithms of three colours, half of it at either camera
    for gain in gains.values():
        assert np.ptp(np.log(gain)) == pytest.approx(mean + np.log(MAX_WHITE_BALANCE), rel=1e-2)
