"""What is drawn from columns of voxels, against rays, closed forms and a slow walk through the same voxels."""

from __future__ import annotations

import numpy as np
import pytest

from mcl_depth.geometry.cloud import cloud_from_points
from mcl_depth.geometry.columns.voxel_map import VoxelMap, voxel_map
from mcl_depth.geometry.columns.walker import Walker
from mcl_depth.geometry.mesh import RayScene, mesh_from_faces, sample_surface
from mcl_depth.geometry.synthesis import panorama_window
from mcl_depth.params import SynthesisParams
from sphere_nav.geometry.cameras.camera import pixel_grid

# Written out: imported, a change would go unseen.
NEAREST_M = 0.2

PARAMS = SynthesisParams(num_columns=180)
CAMERA = panorama_window(PARAMS)
QUADS = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]


def boxes(*corners):
    """Return a mesh of boxes given by low and high corners."""
    vertices = np.concatenate(
        [[np.where(bits, high, low) for bits in np.ndindex(2, 2, 2)] for low, high in np.asarray(corners, float)]
    )
    faces = [
        tuple(8 * k + i for i in face)
        for k in range(len(corners))
        for a, b, c, d in QUADS
        for face in ((a, b, c), (a, c, d))
    ]
    return mesh_from_faces(vertices, np.array(faces), "boxes")


def town():
    """A square of 60 m with houses of 6 to 9 m, a wall across, a pole."""
    return boxes(
        ((-30, -30, -0.5), (30, 30, 0)), ((6, -4, 0), (14, 9, 9)), ((-20, 5, 0), (-8, 12, 6)),
        ((-6, -14, 0), (3, -13, 3)), ((3, 4, 0), (3.3, 4.3, 5)),
    )  # fmt: skip


def walker(cloud, params=PARAMS, window=CAMERA):
    levels = Walker.num_levels(params.voxel_m, window, params)
    return Walker(voxel_map(cloud, params.voxel_m, levels), window, params)


@pytest.mark.slow
def test_a_town_is_drawn_as_rays_see_it() -> None:
    mesh = town()
    places = np.array([[0.0, 0.0, 1.6], [-14.0, -3.0, 1.6], [20.0, 12.0, 1.6]])
    found = walker(sample_surface(mesh, 0.06)).ranges(places)
    exact = RayScene(mesh, CAMERA, PARAMS).ranges(places)
    both = np.isfinite(found) & np.isfinite(exact)
    error = np.abs(found[both] / exact[both] - 1.0)
    assert np.median(error) < 0.01  # planes are met where they are, not where the voxels are
    assert np.mean(error > 0.1) < 0.03  # edges: a voxel is up to a pixel wide
    assert np.mean(np.isnan(found[np.isfinite(exact)])) < 0.01  # nothing is seen through
    assert np.mean(np.isfinite(found[np.isnan(exact)])) < 0.03  # roofs and corners are at most a voxel too wide


def test_ranges_have_their_limits() -> None:
    cloud = sample_surface(boxes(((-6, -6, 0), (6, 6, 3))), 0.05)
    params = SynthesisParams(num_columns=180, max_range_m=6.5)
    found = walker(cloud, params).ranges(np.array([[0.0, 0.0, 1.5]]))[0]
    assert np.nanmin(found) >= NEAREST_M
    assert np.nanmax(found) <= 6.5
    assert np.isnan(found[CAMERA.height // 2]).any()  # the corners are 8.5 m away


def test_the_walk_meets_what_a_slow_one_meets() -> None:
    rng = np.random.default_rng(5)
    floor, others = rng.uniform((0, 0, 0), (4, 4, 0.02), (400, 3)), rng.uniform((0, 0, 0), (4, 4, 1.5), (60, 3))
    points = np.concatenate([floor, others])
    params = SynthesisParams(num_columns=90, voxel_m=0.2, max_range_m=5.0)
    window = panorama_window(params)
    one_level = voxel_map(cloud_from_points(points), 0.2, 1)
    found = Walker(one_level, window, params).ranges(np.array([(2.51, 1.02, 0.4)]))[0]
    expected = slow_walk(one_level, np.array((2.51, 1.02, 0.4)), window, params)
    assert np.mean(np.isnan(found) == np.isnan(expected)) > 0.995  # float32 on the edge of a cell
    both = np.isfinite(found) & np.isfinite(expected)
    assert both.sum() > 150
    assert np.mean(np.isclose(found[both], expected[both], rtol=1e-3)) > 0.99


def slow_walk(voxels: VoxelMap, place: np.ndarray, window, params: SynthesisParams) -> np.ndarray:
    """Every ray against every voxel: the nearest cell counts, in it the highest voxel that the ray meets."""
    level = voxels.levels[0]
    rays, out = window.unproject(pixel_grid(window)), np.full((window.height, window.width), np.nan)
    low, high = level.cells[:, :2] * level.size, (level.cells[:, :2] + 1) * level.size
    eye = place - voxels.corner
    for row, column in np.ndindex(*out.shape):
        ray = rays[row, column] / np.linalg.norm(rays[row, column, :2])
        with np.errstate(divide="ignore"):
            a, b = (low - eye[:2]) / ray[:2], (high - eye[:2]) / ray[:2]
        t0, t1 = np.minimum(a, b).max(axis=1).clip(1e-3), np.maximum(a, b).min(axis=1)
        z0, z1 = eye[2] + ray[2] * t0, eye[2] + ray[2] * t1
        is_met = (t0 < t1) & (np.maximum(z0, z1) >= level.voxels[:, 3]) & (np.minimum(z0, z1) <= level.voxels[:, 4])
        for v in sorted(np.flatnonzero(is_met), key=lambda v: (round(t0[v], 6), -level.cells[v, 2])):
            mean, normal = level.voxels[v, :3] - eye, level.voxels[v, 5:]
            t = normal @ mean / (normal @ ray) if abs(normal @ ray) > 1e-6 else mean[:2] @ ray[:2]
            distance = np.clip(t, t0[v], t1[v]) * np.linalg.norm(ray)
            if NEAREST_M <= distance <= params.max_range_m:
                out[row, column] = distance
                break
    return out
