"""Depth panoramas of a room, as cloud and as mesh, against its closed form."""

from __future__ import annotations

import numpy as np
import pytest

from mcl_depth.geometry.cloud import Geometry, cloud_from_points
from mcl_depth.geometry.mesh import mesh_from_faces
from mcl_depth.geometry.synthesis import DepthSynthesizer, panorama_window
from mcl_depth.params import SynthesisParams
from sphere_nav.geometry.cameras.camera import pixel_grid

PARAMS = SynthesisParams(num_columns=72)
HALF = np.array([4.0, 3.0, 1.5])


def room() -> Geometry:
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * HALF
    quads = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    return mesh_from_faces(corners, np.array(faces), "room")


def expected(place: np.ndarray) -> np.ndarray:
    camera = panorama_window(PARAMS)
    rays = camera.unproject(pixel_grid(camera))
    return np.min(np.where(rays > 0, HALF - place, HALF + place) / np.maximum(np.abs(rays), 1e-12), axis=-1)


def test_a_mesh_is_drawn_exactly() -> None:
    place = np.array([1.0, -0.5, 0.2])
    found = DepthSynthesizer(room(), PARAMS).synthesize_many([place])[0]
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
