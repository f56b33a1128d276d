"""Planes around the pixels of a depth image, in closed form, and what is left out."""

from __future__ import annotations

import numpy as np
import pytest

from rig_calibration.drive.depth_pair import DepthFrame, DepthPair
from rig_calibration.drive.depth_pixels import sample_planes, without_hidden
from rig_calibration.drive.drive_lens import Lens
from sphere_nav.geometry import SE3, Fisheye, Pinhole
from sphere_nav.geometry.cameras.camera import pixel_grid

CAMERA = Pinhole(120, 90, 100.0, 101.0, 58.0, 46.0)


def depth_of(normal, distance, camera=CAMERA):
    """Depth (H, W) along z of the plane n . p = d."""
    rays = camera.unproject(pixel_grid(camera))
    rays = rays / rays[..., 2:]
    return distance / (rays @ np.asarray(normal))


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.3, -0.5, 0.8), (-0.6, 0.2, 0.7)])
def test_points_and_normals_are_those_of_the_plane(normal):
    normal = np.array(normal) / np.linalg.norm(normal)
    depth = depth_of(normal, 2.0)
    points, normals = sample_planes(depth, CAMERA)
    assert len(points) > 3000
    np.testing.assert_allclose(points @ normal, 2.0, atol=1e-9)
    np.testing.assert_allclose(normals, np.broadcast_to(normal, normals.shape), atol=1e-6)
    pixels = CAMERA.project(points)[0]
    np.testing.assert_allclose(pixels, np.rint(pixels), atol=1e-6)
    assert pixels.min() > 5.99  # three times two pixels around each
    assert np.all(pixels.max(axis=0) < [113.01, 83.01])


@pytest.mark.parametrize(("noise", "is_flat"), [(0.008, True), (0.013, False)])
def test_a_plane_is_flat_to_a_hundredth_of_its_depth(noise, is_flat):
    sign = np.where(np.random.default_rng(0).random((90, 120)) < 0.5, -1.0, 1.0)
    points, _ = sample_planes(2.0 * (1.0 + noise * sign), CAMERA)
    assert (len(points) > 2000) == is_flat


@pytest.mark.parametrize(("slope_deg", "is_seen"), [(77.0, True), (80.0, False)])
def test_a_plane_seen_at_a_grazing_angle_is_left_out(slope_deg, is_seen):
    """The limit is a cosine of 0.2, 78.5 degrees, at the middle of the image."""
    narrow = Pinhole(120, 90, 9000.0, 9000.0, 58.0, 46.0)
    normal = [np.sin(np.radians(slope_deg)), 0.0, np.cos(np.radians(slope_deg))]
    assert (len(sample_planes(depth_of(normal, 0.5, narrow), narrow)[0]) > 0) == is_seen


@pytest.mark.parametrize(("share", "is_kept"), [(0.85, True), (0.5, False)])
def test_seven_tenths_around_must_be_measured(share, is_kept):
    rng = np.random.default_rng(1)
    depth = np.where(rng.random((90, 120)) < share, 2.0, np.where(rng.random((90, 120)) < 0.5, np.nan, 0.0))
    points, _ = sample_planes(depth, CAMERA)
    assert (len(points) > 1000) == is_kept
    assert np.all(points[:, 2] == 2.0) if is_kept else len(points) < 50


@pytest.mark.parametrize("camera", [Pinhole(120, 90, 100.0, 101.0, 58.0, 46.0, (-0.1, 0.03, 0.002, -0.001)),
                                    Fisheye(120, 90, 50.0, 51.0, 58.0, 46.0, (0.03, -0.01, 0.002, 0.001))],
                         ids=lambda camera: camera.model)  # fmt: skip
@pytest.mark.parametrize("level", [0, 1])
def test_a_lens_has_the_derivatives_that_it_says_at_every_level(camera, level):
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-0.4, 0.4, (50, 2)), np.ones(50)])
    lens = Lens.of(camera, 0.01)
    J = lens.J_lens(points, level)
    for k, size in enumerate(1e-4 * lens.prior_sigma):
        step = np.zeros(9)
        step[k] = size
        ahead, behind = (one.level(level).project(points)[0] for one in (lens.moved(step), lens.moved(-step)))
        np.testing.assert_allclose(
            J[:, :, k], (ahead - behind) / (2 * size), rtol=1e-3, atol=1e-4 * np.abs(J[..., k]).max()
        )
    assert not J[:, :, 8].any()


def test_what_is_known_of_a_lens_that_nobody_calibrated():
    lens = Lens.of(CAMERA)
    np.testing.assert_allclose(lens.prior_sigma, [10.0, 10.1, 6.0, 6.0, 0.3, 0.3, 0.01, 0.01, 0.02])
    assert lens.moved(np.array([1.0, 2, 3, 4, 0.1, 0.2, 0.3, 0.4, -0.5])).values.tolist() == pytest.approx(
        [101.0, 103.0, 61.0, 50.0, 0.1, 0.2, 0.3, 0.4, 0.0]
    )
    with pytest.raises(ValueError, match="expected k1 k2 p1 p2 at most"):
        Lens.of(Pinhole(120, 90, 100.0, 100.0, 58.0, 46.0, (0.0, 0.0, 0.0, 0.0, 0.1)))


@pytest.mark.parametrize(("times", "is_hidden"), [(1.04, False), (1.06, True)])
def test_what_is_a_twentieth_farther_in_a_square_is_hidden(times, is_hidden):
    near = np.array([0.02, 0.01, 2.0])
    points = np.array([near, near * times, [0.5, 0.4, 2.2], [0.0, 0.0, -1.0]])
    frame = DepthFrame((), points, points, np.zeros(6))
    kept = without_hidden(DepthPair(frame, frame, SE3.identity()), CAMERA, SE3.identity()).second.points_depth
    np.testing.assert_array_equal(kept, points[[True, not is_hidden, True, False]])
