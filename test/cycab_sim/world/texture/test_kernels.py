import numpy as np
import pytest

from cycab_sim.world.noise.kernels import sum_octaves
from cycab_sim.world.texture import kernels

NAMES = [
    "ASPHALT", "PAVING", "BRICK", "PLASTER", "STONE", "WINDOW", "ROOF", "WOOD",
    "SIGN", "METAL", "MARKING", "SOIL", "BARK", "FOLIAGE", "SLATS", "FACADE",
]  # fmt: skip
PARAMS = {
    "PAVING": (0.12, 0.6, 0.4, 0.012, 0.5, 0.0), "BRICK": (0.12, 0.23, 0.075, 0.012, 0.5, 0.0),
    "STONE": (0.12, 0.8, 0.32, 0.012, 0.5, 0.0), "WINDOW": (0.4, 1.2, 1.6, 2.0, 2.0, 0.6),
    "WOOD": (0.12, 1.0, 2.4, 0.0, 0.0, 0.0), "SIGN": (0.1, 1.4, 0.8, 0.03, 0.0, 0.0),
    "METAL": (0.12, 1.1, 0.0, 0.0, 0.0, 0.0), "MARKING": (0.12, 1.0, 0.5, 0.0, 0.0, 0.0),
    "SLATS": (0.12, 0.09, 0.0, 0.0, 0.0, 0.0), "FACADE": (0.1, 2.8, 3.1, 0.0, 0.0, 0.0),
}  # fmt: skip


def foot(width):
    return numbers(width, width, 1.0, 0.0, width, width)


def numbers(*given):
    """Numbers as the renderer has them: others would be compiled for these tests alone."""
    return tuple(map(np.float32, given))


def look(name, uvw, width):
    """Reflectance (...,) of a material at points (..., 3) of its surface through a round footprint."""
    at = np.reshape(uvw, (-1, 3))
    kind = getattr(kernels, name)
    points, seeds = np.empty((8, len(at)), np.float32), np.full(len(at), 77, np.uint32)
    points[:2], points[2:4], points[4], points[5] = at.T[:2], width, 1.0, 0.0
    points[6], points[7] = 1.0 / kernels.SIZES[kind], kernels.GAIN
    rough = np.empty(len(at), np.float32)
    sum_octaves(points, seeds, rough)
    p, kind, seed = numbers(*PARAMS.get(name, (0.12, 0.0, 0.0, 0.0, 0.0, 0.0))), np.int32(kind), np.int32(77)
    seen = [kernels.appearance(kind, *numbers(*q), foot(width), p, seed, r) for q, r in zip(at, rough, strict=True)]
    m, t = np.array(seen).T
    return (m * ((1 - t) * 0.4 + t * 0.15)).reshape(np.shape(uvw)[:-1])


@pytest.mark.slow
def test_from_afar_a_material_is_the_mean_of_what_it_is_nearby(rng):
    for name in NAMES:
        width, n = 0.12, 12
        offsets = width * ((np.arange(n) + 0.5) / n - 0.5)
        patch = np.stack([*np.meshgrid(offsets, offsets), np.zeros((n, n))], axis=-1)
        points = rng.uniform(0.12, 0.72, (60, 3))
        near = look(name, points[:, None, None] + patch, width / n).mean(axis=(1, 2))
        far = look(name, points, width)
        assert far.mean() == pytest.approx(near.mean(), rel=0.10)
        # edges and pulses are averaged over a box, noise by a lens: a tenth of the level is 5 grey levels at 130
        assert np.sqrt(np.mean((near - far) ** 2)) < 0.12 * near.mean()


def test_rays_are_located_on_their_surface_and_in_the_sky():
    rays = np.array([[1.0, 0.0, 0.0], [0.6, 0.0, 0.8], [np.nan, np.nan, np.nan]], np.float32)
    frames = np.array([[[0, 1, 0, 2.0], [0, 0, 1, 1.0], [1, 0, 0, -5.0]]], np.float32)  # the wall x = 5
    kinds = np.array([[kernels.PLASTER, 77]], np.int32)
    hit, ranges = np.array([0, -1, -2], np.int32), np.array([5.0, np.inf, np.nan], np.float32)
    cone, surface_of = np.full(3, 0.002, np.float32), np.zeros(1, np.int32)
    points, depths, seeds = np.empty((8, 3), np.float32), np.empty(3, np.float32), np.empty(3, np.uint32)
    kernels.locate_surfaces(np.zeros(3), rays, ranges, hit, cone, surface_of, frames, kinds, points, depths, seeds)
    np.testing.assert_allclose(points[:4, 0], [2.0, 1.0, 0.01, 0.01], rtol=1e-6)
    assert depths[0] == pytest.approx(0.0, abs=1e-6)
    assert points[0, 1] == pytest.approx(0.6 / 0.92, rel=1e-5)  # on a plane overhead
    assert seeds.tolist()[:2] == [77, kernels.SKY_SEED]
    assert np.all(np.isfinite(points))  # also where there is no ray
