"""The sphere: its axes, its seam, and windows that cross the seam."""

import numpy as np
import pytest

from sphere_nav.geometry import Spherical
from sphere_nav.geometry.cameras.camera import pixel_grid

SPHERE = Spherical(512, 256)


def test_axes_are_where_the_conventions_say():
    looks = {"forward": [1, 0, 0], "left": [0, 1, 0], "right": [0, -1, 0], "up": [0, 0, 1], "down": [0, 0, -1]}
    found = {name: SPHERE.project(np.array(point, float))[0] for name, point in looks.items()}
    np.testing.assert_allclose(found["forward"], [255.5, 127.5])
    np.testing.assert_allclose(found["left"], [127.5, 127.5])
    np.testing.assert_allclose(found["right"], [383.5, 127.5])
    assert found["up"][1] == pytest.approx(-0.5)
    assert found["down"][1] == pytest.approx(255.5)


def test_backward_lies_on_the_seam_from_both_sides():
    left, right = SPHERE.project([[-1.0, 1e-9, 0.0], [-1.0, -1e-9, 0.0]])[0][:, 0]
    assert left == pytest.approx(-0.5, abs=1e-6)
    assert right == pytest.approx(511.5, abs=1e-6)


def test_columns_beyond_the_seam_are_the_columns_of_the_other_side():
    np.testing.assert_allclose(SPHERE.unproject([[-3.0, 100.0]]), SPHERE.unproject([[509.0, 100.0]]), atol=1e-12)


def test_a_window_is_a_cut_of_the_whole_sphere():
    for offset_u in [0.0, 100.5, 420.0, 511.0]:
        window = Spherical(200, 100, 512.0, offset_u, 80.0)
        grid = pixel_grid(window)
        whole = grid + np.array([offset_u, 80.0])
        np.testing.assert_allclose(window.unproject(grid), SPHERE.unproject(whole), atol=1e-12)
        found, visible = window.project(SPHERE.unproject(whole))
        assert visible.all()
        np.testing.assert_allclose(found, grid, atol=1e-9)


def test_a_window_does_not_see_what_is_outside():
    window = Spherical(200, 100, 512.0, 420.0, 80.0)
    outside = np.array([[-2.0, 50.0], [201.0, 50.0], [100.0, -2.0], [100.0, 101.0]])
    assert not window.project(window.unproject(outside))[1].any()


def test_halving_keeps_a_window_inside_the_same_sphere():
    half = Spherical(200, 100, 512.0, 421.0, 81.0).halve()
    assert (half.full_width, half.offset_u, half.offset_v) == (256.0, 210.5, 40.5)
    assert not half.is_whole
    assert SPHERE.halve().is_whole


def test_impossible_spheres_are_refused():
    for arguments in [(512, 512), (200, 100, 100.0), (4, 2, np.nan), (4, 2, 8.0, np.inf)]:
        with pytest.raises(ValueError, match="sphere"):
            Spherical(*arguments)


def test_the_derivative_stays_finite_at_the_poles():
    assert np.isfinite(SPHERE.J_project([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])).all()
