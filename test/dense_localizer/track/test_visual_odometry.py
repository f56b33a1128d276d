"""The last image as a reference (M15 section 5.3): range, covariance of a way, other light, a hidden map."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from dense_localizer.params import LocalizerParams
from dense_localizer.track.visual_odometry import Way, find_finest_level, make_view
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.params import build
from sphere_nav.photometric import View, build_pyramid, prepare_reference, register
from sphere_nav.photometric.align.rig import RigImage
from worlds.localizer import PINHOLE, SMALL_IMAGES, at

PARAMS = build(LocalizerParams, SMALL_IMAGES).registration


def test_an_image_that_was_placed_is_a_reference(room):
    T_sphere, pose = SE3.from_planar(0.3, 0.2, 0.0), at(0.0, 0.0, 0.4)
    sphere = room.sphere(T_sphere, Spherical(512, 256))
    view = View(prepare_reference(sphere.gray, sphere.range_m, sphere.camera, PARAMS), T_sphere)
    image = RigImage(build_pyramid(room.photograph(PINHOLE, pose), PINHOLE, PARAMS.pyramid), views=(view,))
    step = SE3.exp([0.04, -0.02, 0.05, 0.01, -0.02, 0.01])
    now = build_pyramid(room.photograph(PINHOLE, pose @ step, 5), PINHOLE, PARAMS.pyramid)
    alignment = register(now, [make_view(image, pose, PARAMS)], pose, PARAMS)
    assert alignment.is_converged
    assert alignment.T_world_camera.distance(pose @ step) < (0.006, 0.004)


def test_a_reference_is_made_of_at_most_twice_the_pixels_that_are_aligned():
    cameras = [SimpleNamespace(width=w, height=h) for w, h in ((500, 400), (400, 300), (200, 150))]
    seen = [SimpleNamespace(pyramid=SimpleNamespace(cameras=cameras))]
    assert find_finest_level(seen, LocalizerParams()) == 1


def test_a_way_without_the_map_is_the_less_sure_the_longer_it_is(room):
    rng, sigma = np.random.default_rng(3), 1e-3
    poses = [SE3.exp([0.1 * k, 0.0, 0.02 * k, 0.0, 0.05 * k, 0.0]) for k in range(6)]
    found = Way(poses[0], np.zeros((6, 6)), 0)
    for one, other in pairwise(poses):
        found = found.add_step(one, other, sigma**2 * np.eye(6))
    T = poses[0]
    for one, other in pairwise(poses):  # steps that err
        T = T @ (one.inverse() @ other) @ SE3.exp(rng.normal(0, sigma, (4000, 6)))
    ends = (poses[-1].inverse() @ T).log()
    np.testing.assert_allclose(found.noise, np.cov(ends.T), atol=0.12 * found.noise.max())
    lengths = [one.distance(other)[0] for one, other in pairwise(poses)]
    assert found.meters == pytest.approx(sum(lengths))
    last, exact = poses[-1], np.zeros((6, 6))
    longer = [found.add_step(last, last @ SE3.exp([d, 0, 0, 0, 0, 0]), exact) for d in (0.0, 1.0, 5.0)]
    sigmas = [np.trace(one.covariance_at(last)) for one in longer]
    assert sigmas[0] < sigmas[1] < sigmas[2]


def test_a_place_that_was_unsure_along_the_street_stays_so_however_the_camera_turns():
    turned, start = SE3.from_planar(0.0, 0.0, 0.6), np.diag([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    found = Way(SE3.identity(), start, 0).covariance_at(turned)[:3, :3]
    np.testing.assert_allclose(turned.rotation @ found @ turned.rotation.T, start[:3, :3], atol=1e-12)


def test_a_way_by_images_alone_drifts_with_its_length():
    way = Way(SE3.identity(), np.zeros((6, 6)), 0)
    for k in range(10):
        way = way.add_step(SE3.from_planar(k, 0.0, 0.0), SE3.from_planar(k + 1.0, 0.0, 0.0), np.zeros((6, 6)))
    sigma = np.sqrt(np.diag(way.covariance_at(SE3.from_planar(10.0, 0.0, 0.0))))
    np.testing.assert_allclose(sigma, np.repeat([0.2, 0.04], 3))  # 2 % and 4 mrad a metre
