import numpy as np

from cycab_sim.params import LightParams, RenderParams
from cycab_sim.rendering.renderer import Renderer
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
