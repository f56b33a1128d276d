"""Depth panoramas of a room and a town, as cloud and as mesh, against closed forms and rays; which points are dense."""

from __future__ import annotations

import numpy as np
import pytest

from mcl_depth.geometry.cloud import Geometry, cloud_from_points
from mcl_depth.geometry.mesh import RayScene, mesh_from_faces, sample_surface
from mcl_depth.geometry.synthesis import DepthSynthesizer, Splats, panorama_window, surfels_of
from mcl_depth.params import SynthesisParams
from sphere_nav.geometry.cameras.camera import pixel_grid

PARAMS, FINE = SynthesisParams(num_columns=72), SynthesisParams(num_columns=180)
HALF = np.array([4.0, 3.0, 1.5])


QUADS = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]


def boxes(*corners: tuple[tuple[float, ...], tuple[float, ...]]) -> Geometry:
    vertices = [[np.where(bits, high, low) for bits in np.ndindex(2, 2, 2)] for low, high in np.asarray(corners, float)]
    faces = np.array([face for a, b, c, d in QUADS for face in ((a, b, c), (a, c, d))])
    indices = np.concatenate([faces + 8 * k for k in range(len(corners))])
    return mesh_from_faces(np.concatenate(vertices), indices, "boxes")


def expected(place: np.ndarray) -> np.ndarray:
    camera = panorama_window(PARAMS)
    rays = camera.unproject(pixel_grid(camera))
    return np.min(np.where(rays > 0, HALF - place, HALF + place) / np.maximum(np.abs(rays), 1e-12), axis=-1)


def test_a_mesh_is_drawn_exactly() -> None:
    place = np.array([1.0, -0.5, 0.2])
    found = DepthSynthesizer(boxes((tuple(-HALF), tuple(HALF))), PARAMS).synthesize_many([place])[0]
    np.testing.assert_allclose(found, expected(place), rtol=1e-4)  # float32 rays


def test_far_tiles_are_drawn_from_coarser_copies_where_they_lie() -> None:
    rng = np.random.default_rng(1)
    wall = np.column_stack([np.full(40_000, 30.0), rng.uniform(-20, 20, 40_000), rng.uniform(-5, 5, 40_000)])
    found = DepthSynthesizer(cloud_from_points(wall), PARAMS).synthesize_many([(0.0, 0.0, 0.0)])[0]
    middle = found[found.shape[0] // 2]
    assert abs(float(middle[36]) - 30.0) < 0.3  # forward is the centre column, the wall is 30 m away
    assert np.isnan(middle[0])  # behind there is nothing


@pytest.mark.parametrize(("distance", "is_drawn"), [(0.19, False), (0.21, True)])
def test_nothing_is_drawn_nearer_than_twenty_centimeters(distance: float, is_drawn: bool) -> None:
    cloud = cloud_from_points(np.array([[distance, 0.0, 0.0], [-50.0, 0.0, 0.0]]))
    found = DepthSynthesizer(cloud, PARAMS).synthesize_many([(0.0, 0.0, 0.0)])[0]
    assert (np.nanmin(found) < 1.0) == is_drawn


def test_one_point_and_one_triangle_lie_where_they_are() -> None:
    camera = panorama_window(PARAMS)
    place = np.zeros((1, 3))
    points = Splats(cloud_from_points(np.array([[0.0, 5.0, 0.0]])), camera, PARAMS).ranges(place)[0]
    corners = np.array([[-1.0, 5.0, -1.0], [1.0, 5.0, -1.0], [0.0, 5.0, 2.0]])
    surface = RayScene(mesh_from_faces(corners, np.array([[0, 1, 2]]), "one"), camera, PARAMS).ranges(place)[0]
    for found in (points, surface):
        rows, columns = np.nonzero(np.isfinite(found))
        assert abs(np.median(columns) - 17.5) <= 1.0  # 90 degrees to the left is a quarter of the way
        assert abs(np.nanmin(found) - 5.0) < 0.02  # a pixel is 5 degrees wide
        assert len(rows) >= 1


@pytest.mark.slow
def test_a_town_is_drawn_as_rays_see_it() -> None:
    mesh = boxes(
        ((-30, -30, -0.5), (30, 30, 0)), ((6, -4, 0), (14, 9, 9)), ((-20, 5, 0), (-8, 12, 6)),
        ((-6, -14, 0), (3, -13, 3)), ((3, 4, 0), (3.3, 4.3, 5)),
    )  # fmt: skip
    places = np.array([[0.0, 0.0, 1.6], [-14.0, -3.0, 1.6], [20.0, 12.0, 1.6]])
    found = RayScene(surfels_of(sample_surface(mesh, 0.06), 0.1)[0], panorama_window(FINE), FINE).ranges(places)
    exact = RayScene(mesh, panorama_window(FINE), FINE).ranges(places)
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
