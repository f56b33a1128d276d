import numpy as np
import pytest

from cycab_sim.params import LightParams, RenderParams
from cycab_sim.rendering.renderer import SUN_STEP, Renderer
from cycab_sim.rendering.sky import light_at
from cycab_sim.sensors.cameras import OPTICAL
from sphere_nav.geometry import SE3, Pinhole

QUICK = RenderParams(shadow_texel=0.25)
NEAR = (-14.0, -14.0, 14.0, 14.0)  # of the box: shadows no further


def test_a_sun_put_elsewhere_is_as_if_it_had_been_there(box_mesh):
    east, west = LightParams(sun="0,43"), LightParams(sun="180,43")
    moved, there = Renderer(box_mesh, QUICK, east, bounds=NEAR), Renderer(box_mesh, QUICK, west, bounds=NEAR)
    before = moved._shadows.depths
    moved.illuminate(light_at(west, 0.0, 1))
    assert not np.array_equal(before, moved._shadows.depths)
    camera, pose = Pinhole(60, 40, 40.0, 40.0, 29.5, 19.5), SE3.from_parts(OPTICAL, [0.0, 0.0, 1.5])
    np.testing.assert_array_equal(moved.render(camera, pose)[0], there.render(camera, pose)[0])


def test_shadows_wait_until_the_sun_has_moved_by_a_step(box_mesh):
    renderer = Renderer(box_mesh, QUICK, LightParams(sun="0,40"), bounds=NEAR)
    before = renderer._shadows.depths
    step = float(np.degrees(SUN_STEP))
    renderer.illuminate(light_at(LightParams(sun=f"0,{40.0 + 0.5 * step}"), 0.0, 1))
    assert renderer._shadows.depths is before
    renderer.illuminate(light_at(LightParams(sun=f"0,{40.0 + 1.5 * step}"), 0.0, 1))
    assert renderer._shadows.depths is not before


@pytest.mark.parametrize("has_shadows", [True, False])
def test_what_moves_is_drawn_over_what_stands(box_mesh, has_shadows):
    renderer = Renderer(box_mesh, RenderParams(shadow_texel=0.25 * has_shadows), LightParams(), bounds=NEAR)
    shadows, still = renderer._shadows, renderer._shadows.depths.copy()
    plate = np.array([[[-2, -2, 6], [2, -2, 6], [2, 2, 6]]], np.float32)
    shadows.draw(plate)
    assert (shadows.depths < still).any() == has_shadows
    shadows.draw(plate + np.float32(1000.0))
    np.testing.assert_array_equal(shadows.depths, still)
