"""Kernels against the same in NumPy."""

from dataclasses import replace

import numpy as np
import pytest

from sphere_mapping.acquisition import kernels
from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.range.fusion import fuse_sources
from sphere_mapping.acquisition.stitching.layouts import Layouts
from sphere_mapping.acquisition.stitching.strips import Block
from sphere_mapping.acquisition.stitching.views import continued_lens, warp
from sphere_nav.geometry import SE3, DoubleSphere, Fisheye, Pinhole, Rig, RigCamera, Spherical
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.params import build
from worlds.rig import OPTICAL

LENSES = (
    Fisheye(160, 160, 48.0, 50.0, 79.5, 77.5, (-0.02, 0.002, 0.0, 0.0)),
    DoubleSphere(160, 120, 60.0, 60.0, 79.5, 59.5, -0.2, 0.6),
    Pinhole(160, 120, 90.0, 90.0, 79.5, 59.5, (-0.1, 0.01, 0.002, -0.003)),
)
PARAMS = build(StitchParams, {"width": 128})


def test_smoothing_keeps_slopes_and_edges():
    rows, columns = np.mgrid[0:30, 0:40].astype(np.float32)
    plane = np.float32(10) + np.float32(0.1) * rows + np.where(columns < 20, 0, 9).astype(np.float32)
    noisy = plane + np.random.default_rng(1).normal(0, 0.2, plane.shape).astype(np.float32)
    noisy[5, 5] = np.nan
    out = kernels.smooth(noisy, 3, np.float32(1.0), np.float32(0.03))
    assert np.isnan(out[5, 5])
    assert np.isnan(out).sum() == 1
    inner = (slice(3, -3), slice(3, -3))
    assert np.nanstd((out - plane)[inner]) < 0.06  # 49 values, some of them too far off to be averaged


def test_fused_range_is_the_weighted_mean_unless_denied():
    def fuse(*values):
        found = fuse_sources([tuple(np.full((1, 1), x, np.float32) for x in one) for one in values], Spherical(2, 1))
        return found[0][0, 0], found[1][0, 0]

    assert fuse((10.0, 0.1), (10.3, 0.2))[0] == pytest.approx(10.06)
    assert fuse((10.0, 0.1), (10.3, 0.2))[1] == pytest.approx(0.2 * 0.1 / np.hypot(0.1, 0.2))
    assert np.isnan(fuse((10.0, 0.1), (14.0, 0.2))[0])  # about as sure, and elsewhere
    assert fuse((10.0, 0.1), (14.0, 0.9))[0] == 10.0  # far less sure
    assert fuse((10.0, 0.01), (10.4, 0.02))[0] == 10.0  # differs by little
    assert np.isinf(fuse((np.inf, np.nan), (np.nan, np.nan))[0])
    assert np.isnan(fuse((np.nan, np.nan), (np.nan, np.nan))[0])


@pytest.mark.parametrize("lens", LENSES)
def test_pixels_by_range_are_where_the_camera_sees_these_points_whatever_its_model(lens):
    view = Layouts(Rig((RigCamera("a", lens, SE3.from_parts(OPTICAL, [0.1, 0.3, -0.2])),)), PARAMS, {}).views["a"]
    view = replace(view, T_sphere_camera=SE3.from_parts(OPTICAL, [0.1, 0.3, -0.2]))
    inverse = np.random.default_rng(4).uniform(0, 1, (64, 128)).astype(np.float32)
    block = Block(3, 15, 50, 110)
    found = np.stack(warp(continued_lens(view.lens), inverse, block))
    rays = block.cut(pixel_rays(Spherical(128, 64)))
    *expected, border = view.project(rays / np.maximum(block.cut(inverse), 1e-6)[..., None])
    seen = border > 0.1
    assert seen.mean() > 0.05
    np.testing.assert_allclose(found[:, seen], np.stack(expected)[:, seen], atol=0.02)
    bounds = np.array([lens.width, lens.height])[:, None, None] + 40.0
    assert (np.abs(found) < bounds).all()  # what is not seen is next to what is


def test_a_step_of_alignment_is_that_of_least_squares():
    """The mean of what the slopes say and what the match says, each by its information (step_blocks's formulas)."""
    rng = np.random.default_rng(7)
    s, e = rng.normal(0, 80, (2, 30, 49)).round()
    sums = np.stack([np.full_like(s, 1), s, e, s * s, s * e, e * e]).sum(axis=2).astype(np.int32)
    sums[:, 3] = 0
    limits = np.float32([0.2, 20.0, 12.0, 0.25])  # px, pixels of a block, grey levels^2, px^2
    limit, _, noise, prior = limits
    start, before = (rng.normal(5, 0.5, 30).astype(np.float32) for _ in range(2))
    disparity, information, left = before.copy(), np.empty(30, np.float32), np.empty(30, np.float32)
    kernels.step_blocks(sums, limits, start, disparity, information, left)
    slopes, errors = s / 16, e / 16
    variance = slopes.var(axis=1)
    covariance = ((slopes - slopes.mean(axis=1, keepdims=True)) * errors).mean(axis=1)
    wanted, seen = covariance / variance, variance * 49 / 2 / noise
    step = (seen * wanted + (start - before) / prior) / (seen + 1 / prior)
    residual = (errors.var(axis=1) - covariance**2 / variance) / 2
    known = np.arange(30) != 3
    np.testing.assert_allclose(disparity[known], (before + np.clip(step, -limit, limit))[known], rtol=1e-4)
    np.testing.assert_allclose(left[known], (residual / (noise + variance))[known], rtol=1e-4)
    np.testing.assert_allclose(information[known], (variance * 49 / 2 / np.maximum(residual, noise))[known], rtol=1e-4)
    assert (disparity[3], information[3], left[3]) == (before[3], 0.0, np.inf)
    assert np.abs(step[known]).min() < limit < np.abs(step[known]).max()
