import numpy as np
import pytest

from cycab_sim.texture import kernels

NAMES = [
    "ASPHALT",
    "PAVING",
    "BRICK",
    "PLASTER",
    "STONE",
    "WINDOW",
    "ROOF",
    "WOOD",
    "SIGN",
    "METAL",
    "MARKING",
    "SOIL",
    "BARK",
    "FOLIAGE",
    "SLATS",
    "FACADE",
]
PARAMS = {
    "PAVING": (0.12, 0.6, 0.4, 0.012, 0.5, 0.0), "BRICK": (0.12, 0.23, 0.075, 0.012, 0.5, 0.0),
    "STONE": (0.12, 0.8, 0.32, 0.012, 0.5, 0.0), "WINDOW": (0.4, 1.2, 1.6, 2.0, 2.0, 0.6),
    "WOOD": (0.12, 1.0, 2.4, 0.0, 0.0, 0.0), "SIGN": (0.1, 1.4, 0.8, 0.03, 0.0, 0.0),
    "METAL": (0.12, 1.1, 0.0, 0.0, 0.0, 0.0), "MARKING": (0.12, 1.0, 0.5, 0.0, 0.0, 0.0),
    "SLATS": (0.12, 0.09, 0.0, 0.0, 0.0, 0.0), "FACADE": (0.1, 2.8, 3.1, 0.0, 0.0, 0.0),
}  # fmt: skip


def foot(width):
    return (width, width, 1.0, 0.0, width, width)


def look(name, u, v, w, width):
    p = np.array(PARAMS.get(name, (0.12, 0.0, 0.0, 0.0, 0.0, 0.0)), np.float32)
    m, t = kernels.appearance(getattr(kernels, name), u, v, w, foot(width), p, 77)
    return m * ((1 - t) * 0.4 + t * 0.15)


@pytest.mark.parametrize("name", NAMES)
def test_a_material_has_detail_at_every_scale(name, rng):
    points = rng.uniform(0.15, 0.75, (60, 3))
    fine = np.array([look(name, *p, 0.002) for p in points])
    near = np.array([look(name, *(p + np.array([0.01, 0.01, 0.0])), 0.002) for p in points])
    assert np.all(np.isfinite(fine))
    assert fine.std() > 0.02 * fine.mean()
    assert (fine - near).std() > 0.005 * fine.mean()  # one centimetre makes a difference


@pytest.mark.parametrize("name", NAMES)
def test_from_afar_a_material_is_the_mean_of_what_it_is_nearby(name, rng):
    width, n = 0.12, 12
    offsets = width * ((np.arange(n) + 0.5) / n - 0.5)
    near, far = [], []
    for u, v, w in rng.uniform(0.12, 0.72, (60, 3)):
        near.append(np.mean([look(name, u + a, v + b, w, width / n) for a in offsets for b in offsets]))
        far.append(look(name, u, v, w, width))
    near, far = np.array(near), np.array(far)
    assert far.mean() == pytest.approx(near.mean(), rel=0.10)
    # edges and pulses are averaged over a box, noise by a lens: a tenth of the level is 5 grey levels at 130
    assert np.sqrt(np.mean((near - far) ** 2)) < 0.12 * near.mean()


def test_paint_puts_colours_where_the_rays_end():
    rays = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], np.float32)
    frames = np.array([[[0, 1, 0, 2.0], [0, 0, 1, 1.0], [1, 0, 0, -5.0]]], np.float32)  # the wall x = 5
    out = np.empty((2, 3), np.float32)
    p = np.array([[0.12, 0, 0, 0, 0, 0]], np.float32)
    colours = np.array([[[0.4, 0.3, 0.2], [0.1, 0.1, 0.1]]], np.float32)
    kinds = np.array([[kernels.PLASTER, 77]], np.int32)
    cone = np.full(2, 0.002, np.float32)
    ranges, hit = np.array([5.0, np.inf], np.float32), np.array([0, -1], np.int32)
    kernels.paint(np.zeros(3), rays, ranges, hit, cone, np.zeros(1, np.int32), frames, kinds, p, colours, out)
    m, t = kernels.appearance(kernels.PLASTER, 2.0, 1.0, 0.0, foot(0.01), p[0], 77)
    np.testing.assert_allclose(out[0], m * ((1 - t) * colours[0, 0] + t * colours[0, 1]), rtol=1e-4)
    assert 0.1 < out[1].mean() < 1.2  # the sky


def test_a_flat_view_stretches_the_footprint():
    kernel = getattr(kernels._footprint, "py_func", kernels._footprint)
    A = np.hstack([np.eye(3), np.zeros((3, 1))]).astype(np.float32)
    slant = np.radians(20.0)
    minor, major, bu, bv, fu, fv = kernel(A, np.array([np.cos(slant), 0.0, -np.sin(slant)]), 0.01)
    assert (minor, bu, bv, fv) == pytest.approx((0.01, 1.0, 0.0, 0.01), abs=1e-9)
    assert major == pytest.approx(0.01 / np.sin(slant))
    assert fu == pytest.approx(major)
