from dataclasses import replace

import numpy as np
import pytest

from cycab_sim.params import LightParams, RenderParams, SeasonParams
from cycab_sim.rendering.embree import PacketScene
from cycab_sim.rendering.renderer import Renderer
from cycab_sim.rendering.shadows import ShadowMap
from cycab_sim.rendering.weather import PixelView, Weather
from cycab_sim.sensors.cameras import OPTICAL
from cycab_sim.world.finishes import ASPHALT
from cycab_sim.world.mesh import MeshBuilder
from sphere_nav.geometry import SE3, Pinhole

CAMERA = Pinhole(160, 120, 95.0, 95.0, 79.5, 59.5)
QUICK = RenderParams(shadow_texel=0.3, supersampling=1)
NEAR = (-14.0, -14.0, 14.0, 14.0)
NIGHT = LightParams(sun="300,23h", exposure=300.0)
DOWN = SE3.from_parts(np.diag([1.0, -1.0, -1.0]), [2.0, 0.0, 12.0])  # looks down from above the box, x to the right
AHEAD = SE3.from_parts(OPTICAL, [0.0, 0.0, 1.5])


def radiance(mesh, light=NIGHT, season=None, pose=AHEAD, torch=None):
    """Return the radiance (H, W, 3) before the exposure, in the unit of the light, and the range (H, W) m."""
    renderer = Renderer(mesh, QUICK, light, bounds=NEAR, season=season)
    renderer.torch = torch
    image, range_m = renderer.render(CAMERA, pose)
    return (image / 255.0) ** 2.2 / light.exposure, range_m


def test_what_stands_before_a_lamp_takes_its_light(box_mesh):
    torch = SE3.from_parts(np.eye(3), [0.0, 0.0, 1.0])
    lit, range_m = radiance(box_mesh, replace(NIGHT, torch=2000.0), pose=DOWN, torch=torch)
    dark, _ = radiance(box_mesh, pose=DOWN)
    rays = CAMERA.unproject(np.stack(np.meshgrid(np.arange(160.0), np.arange(120.0)), axis=-1))
    x, y, z = np.moveaxis(DOWN.apply((rays * range_m[..., None]).reshape(-1, 3)).reshape(120, 160, 3), -1, 0)
    before = (z < 0.01) & (np.abs(y) < 0.6) & (x > 2.0) & (x < 4.5)
    behind = (z < 0.01) & (np.abs(y) < 0.6) & (x > 7.5) & (x < 10.0)
    assert np.median((lit - dark)[before]) > 1e-5
    assert np.abs((lit - dark)[behind]).max() < 1e-9


HEIGHT = 0.4  # of the level ground below, m


def weather_of(season, noise=0.0):
    """Return weather over level ground without a roof, and a view of it from 1.5 m above in three slopes."""
    mesh = MeshBuilder(np.random.default_rng(1))
    mesh.panels([[[-50, -50, HEIGHT], [50, -50, HEIGHT], [50, 50, HEIGHT], [-50, 50, HEIGHT]]], ASPHALT)
    built = mesh.build()
    sky = ShadowMap(PacketScene(built.triangles), (0.0, 1.0), np.array([0.0, 0.0, 1.0]), np.zeros(3))  # open
    weather = Weather(built, LightParams(), season, sky)
    weather._noise = lambda *_: np.full(3, noise, np.float32)
    down = np.array([0.2, 0.5, 0.9])
    rays = np.stack([0.6 * np.sqrt(1 - down**2), 0.8 * np.sqrt(1 - down**2), -down], axis=1).astype(np.float32)
    ranges, triangles, cone = (1.5 / down).astype(np.float32), np.zeros(3, np.int32), np.full(3, 1e-3, np.float32)
    return weather, PixelView(np.array([1.0, 2.0, HEIGHT + 1.5]), rays, ranges, triangles, cone)


def test_wet_ground_mirrors_what_a_viewer_below_it_would_see():
    """A puddle of water: Fresnel's share by Schlick, 1 at a grazing view, and a fixed point where both are alike."""
    weather, view = weather_of(SeasonParams(wet=0.6), noise=0.9)
    asked = []

    def look(*question):
        asked.append(question)
        return np.full((3, 3), 7.0, np.float32)

    color = np.full((3, 3), 2.0, np.float32)
    weather.mirror(view, color, look)
    ((below, rays, points, _),) = asked
    np.testing.assert_allclose(below, [1.0, 2.0, HEIGHT - 1.5], atol=1e-6)
    np.testing.assert_allclose(rays, view.rays * [1.0, 1.0, -1.0], atol=1e-7)
    np.testing.assert_allclose(points, view.origin + view.ranges[:, None] * view.rays, atol=1e-5)
    share = 0.6 * (0.02 + 0.98 * (1.0 + view.rays[:, 2]) ** 5)
    np.testing.assert_allclose(color, 2.0 + 5.0 * np.repeat(share[:, None], 3, axis=1), rtol=1e-5)
    alike = np.full((3, 3), 7.0, np.float32)
    weather.mirror(view, alike, look)
    np.testing.assert_allclose(alike, 7.0, rtol=1e-6)


def test_a_condition_looks_as_it_does(box_mesh, fingerprint):
    """Its mean, scatter and pattern, to a hundredth: one pixel at an edge that falls to the other side is less."""
    for light, season, numbers in [
        (LightParams(sun="300,17h"), SeasonParams(), [-4.497, 0.867, -1.093]),
        (LightParams(overcast=0.5), SeasonParams(snow=0.6), [-1.183, 0.605, -1.162]),
        (LightParams(sun="300,12h", overcast=0.3), SeasonParams(wet=0.7), [-1.386, 0.776, -0.833]),
        (replace(NIGHT, has_street_lamps=True, torch=400.0), SeasonParams(wet=0.3), [-9.753, 1.745, -0.922]),
    ]:
        lamps = replace(box_mesh, lamps=np.array([[4.0, 3.0, 5.0]]))
        torch = SE3.exp([0.5, 0.2, 1.2, 0.0, 0.1, -0.1])
        found, _ = radiance(lamps, light, season, torch=torch)
        blocks = found.reshape(12, 10, 16, 10, 3).mean(axis=(1, 3)) / found.mean()
        assert [np.log(found.mean()), blocks.std(), *fingerprint(blocks)] == pytest.approx(numbers, abs=0.01)
