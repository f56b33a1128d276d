"""A white wall all around, seen by two fisheyes whose lenses darken towards the rim."""

import numpy as np
import pytest

from sphere_geometry import SE3, Fisheye, RigCamera, Spherical
from sphere_geometry.camera import pixel_grid
from sphere_map.sphere import T_BODY_OPTICAL
from sphere_mapping.acquisition.exposure import MAX_WHITE_BALANCE, gains_of, overlaps_of
from sphere_mapping.acquisition.views import RigView, border_of

LENS = Fisheye(240, 240, 70.0, 70.0, 119.5, 119.5)
WHOLE = Spherical(2048, 1024)
YAW = {"a": 0.0, "b": 1.2}  # rad; b looks to the left of a


def rig_view(name, mask=None):
    T = SE3.exp([0, 0, 0, 0, 0, YAW[name]]) @ T_BODY_OPTICAL
    return RigView(name, LENS, T, border_of(RigCamera(name, LENS, T), mask))


def picture(level=200.0, falloff=0.35, colours=(1.0, 1.0, 1.0)):
    rays = LENS.unproject(pixel_grid(LENS))
    angle = np.nan_to_num(np.arccos(np.clip(rays[..., 2], -1, 1)))
    grey = level * np.exp(-falloff * angle**2)
    return np.clip(np.rint(grey[..., None] * np.array(colours)), 0, 255).astype(np.uint8)


def gains(pictures, mask_of_b=None):
    overlaps = overlaps_of([rig_view("a"), rig_view("b", mask_of_b)], WHOLE, 0.0)
    return gains_of(pictures, overlaps, {"a": "a", "b": "b"}, 3.0)


def test_lenses_that_darken_towards_the_rim_get_no_gain():
    """Half of b is masked, so that its rim looks where a's middle does: a median of all says 'b is dark'."""
    mask = np.full((240, 240), 255, np.uint8)
    mask[:, :130] = 0
    found = gains({"a": picture(), "b": picture()}, mask)
    np.testing.assert_allclose(found["a"] / found["b"], 1.0, atol=0.03)


def test_the_ratio_of_exposures_is_found_beside_the_falloff():
    found = gains({"a": picture(), "b": picture(140.0)})
    np.testing.assert_allclose(found["b"] / found["a"], 200 / 140, rtol=0.02)


def test_a_colour_departs_from_its_camera_by_the_bound_at_most():
    found = gains({"a": picture(), "b": picture(colours=(1.0, 0.5, 1.0))})
    grey = np.log(2.0) / 6  # half of the difference of the mean of three logarithms
    for name, sign in (("a", -1.0), ("b", 1.0)):
        departure = np.abs(np.log(found[name]) - sign * grey)
        assert departure.max() == pytest.approx(np.log(MAX_WHITE_BALANCE), rel=1e-2)


def test_a_small_difference_of_colour_is_made_equal():
    found = gains({"a": picture(), "b": picture(colours=(1.0, 0.9, 1.0))})
    assert found["b"][1] / found["a"][1] == pytest.approx(1 / 0.9, rel=0.02)
