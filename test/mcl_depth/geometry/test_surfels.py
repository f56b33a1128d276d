"""What is drawn of dense points, against rays; which points are dense."""

from __future__ import annotations

import numpy as np
import pytest

from mcl_depth.geometry.cloud import Geometry, cloud_from_points
from mcl_depth.geometry.mesh import RayScene, mesh_from_faces, sample_surface
from mcl_depth.geometry.surfels import surfels_of
from mcl_depth.geometry.synthesis import panorama_window
from mcl_depth.params import SynthesisParams

PARAMS = SynthesisParams(num_columns=180)
CAMERA = panorama_window(PARAMS)
QUADS = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]


def boxes(*corners: tuple[tuple[float, ...], tuple[float, ...]]) -> Geometry:
    vertices = [[np.where(bits, high, low) for bits in np.ndindex(2, 2, 2)] for low, high in np.asarray(corners, float)]
    faces = np.array([face for a, b, c, d in QUADS for face in ((a, b, c), (a, c, d))])
    indices = np.concatenate([faces + 8 * k for k in range(len(corners))])
    return mesh_from_faces(np.concatenate(vertices), indices, "boxes")


@pytest.mark.slow
def test_a_town_is_drawn_as_rays_see_it() -> None:
    mesh = boxes(
        ((-30, -30, -0.5), (30, 30, 0)), ((6, -4, 0), (14, 9, 9)), ((-20, 5, 0), (-8, 12, 6)),
        ((-6, -14, 0), (3, -13, 3)), ((3, 4, 0), (3.3, 4.3, 5)),
    )  # fmt: skip
    places = np.array([[0.0, 0.0, 1.6], [-14.0, -3.0, 1.6], [20.0, 12.0, 1.6]])
    found = RayScene(surfels_of(sample_surface(mesh, 0.06), 0.1)[0], CAMERA, PARAMS).ranges(places)
    exact = RayScene(mesh, CAMERA, PARAMS).ranges(places)
    both = np.isfinite(found) & np.isfinite(exact)
    error = np.abs(found[both] / exact[both] - 1.0)
    assert np.median(error) < 0.002  # planes are met where they are, not where the voxels are
    assert np.mean(error > 0.1) < 0.015  # edges
    assert np.mean(np.isnan(found[np.isfinite(exact)])) < 0.002  # nothing is seen through
    assert np.mean(np.isfinite(found[np.isnan(exact)])) < 0.015  # roofs and corners are hardly wider


def test_what_is_sparse_or_a_line_is_not_dense() -> None:
    rng = np.random.default_rng(3)
    wall = rng.uniform((0, 0, 0), (4, 0, 3), (20_000, 3))
    assert surfels_of(cloud_from_points(wall), 0.1)[1] > 0.95
    assert surfels_of(cloud_from_points(wall[:150]), 0.1)[1] < 0.05
    wire = np.column_stack([np.linspace(0, 20, 4000), *rng.normal(5.0, 2e-3, (2, 4000))])
    assert surfels_of(cloud_from_points(wire), 0.1)[1] < 0.01


def test_a_single_point_is_drawn_and_a_cloud_too_wide_is_refused() -> None:
    assert len(surfels_of(cloud_from_points(np.ones((1, 3))), 0.1)[0].triangles) == 1
    with pytest.raises(ValueError, match="expected an extent below"):
        surfels_of(cloud_from_points(np.array([[0.0, 0.0, 0.0], [200.0, 0.0, 0.0]])), 1e-4)
