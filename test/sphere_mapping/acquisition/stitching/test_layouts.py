"""Where the spheres of a rig are, and which tables are made for which cameras."""

import numpy as np
import pytest

from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.stitching.layouts import Layouts, center_of, upright
from sphere_nav.params import build
from worlds.rig import WIDTH, vertical_rig


@pytest.fixture(scope="module")
def layouts():
    return Layouts(vertical_rig(), build(StitchParams, {"width": WIDTH}), {})


def test_the_sphere_is_in_the_middle_of_the_top_cameras_and_looks_ahead(layouts):
    top, bottom = (center_of(layouts.rig.at_level(level)) for level in ("top", "bottom"))
    np.testing.assert_allclose(layouts.T_rig_sphere.translation, top, atol=1e-12)
    assert layouts.baseline_m == pytest.approx(np.linalg.norm(top - bottom))
    np.testing.assert_allclose(layouts.T_rig_sphere.rotation[:, 2], (top - bottom) / layouts.baseline_m, atol=1e-12)
    assert layouts.T_rig_sphere.rotation[0, 0] > 0.9


def test_an_upright_frame_keeps_its_axis_and_turns_to_the_front():
    z = np.array([0.0, 0.6, 0.8])
    R = upright(z, np.array([1.0, 1.0, 0.0]))
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(R[:, 2], z)
    assert R[:, 0] @ [1.0, 1.0, 0.0] > 0
    assert np.linalg.det(R) == pytest.approx(1.0)
