from dataclasses import replace

import numpy as np
import pytest

from cycab_sim.params import LightParams, RenderParams
from cycab_sim.rendering.renderer import Renderer
from cycab_sim.sensors.scanner import Scanner, ScannerModel
from sphere_nav.geometry import SE3

EXACT = ScannerModel(noise=0.0, x=0.0, z=0.6, first_deg=-90.0, last_deg=90.0, num_rays=181)


@pytest.fixture(scope="module")
def measure(box_mesh):
    return Renderer(box_mesh, RenderParams(shadow_texel=0.0), LightParams()).measure


def test_a_known_wall_is_where_it_is_also_of_a_scanner_that_is_turned(measure):
    scanner = Scanner(1, EXACT)
    scan = scanner.scan(measure, SE3.identity(), 0)
    wall = np.abs(np.tan(scanner.angles)) * 5.0 < 0.99  # x = 5, 1 m to either side
    assert wall.sum() == 23
    np.testing.assert_allclose(scan[wall], 5.0 / np.cos(scanner.angles[wall]), atol=1e-4)
    assert np.all(np.isposinf(scan[np.abs(scanner.angles) > 0.3]))  # nothing there
    scanner = Scanner(1, EXACT)
    scan = scanner.scan(measure, SE3.from_planar(0.0, 0.0, -np.radians(40.0)), 0)
    hit = np.degrees(scanner.angles[np.isfinite(scan)])
    assert hit.mean() == pytest.approx(40.0, abs=0.5)  # the box is to the left now


def test_a_tilted_scanner_sees_the_ground(measure):
    nose_down = SE3.exp(np.array([0.0, 0.0, 0.0, 0.0, 0.2, 0.0]))
    scanner = Scanner(1, replace(EXACT, x=-1.0, z=0.6))
    ahead = scanner.scan(measure, nose_down, 0)[90]
    height = float((nose_down @ scanner.T_base_scan).translation[2])
    assert ahead == pytest.approx(height / np.sin(0.2), abs=1e-3)


def test_noise_has_the_size_asked_for_and_depends_on_the_scan(measure):
    dense = replace(EXACT, noise=0.03, first_deg=-11.0, last_deg=11.0, num_rays=4000)
    scanner = Scanner(1, dense)
    first, again, later = (scanner.scan(measure, SE3.identity(), index) for index in (0, 0, 1))
    errors = first - 5.0 / np.cos(scanner.angles)
    assert errors.std() == pytest.approx(0.03, rel=0.06)  # 5 sigma of 4000 draws
    assert abs(errors.mean()) < 0.0025
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, later)


def test_out_of_reach_is_infinite_and_too_close_negative(measure):
    far = Scanner(1, replace(EXACT, max_range=4.9)).scan(measure, SE3.identity(), 0)
    assert np.all(np.isposinf(far))
    near = Scanner(1, replace(EXACT, min_range=5.05)).scan(measure, SE3.identity(), 0)
    assert np.isneginf(near[90])
