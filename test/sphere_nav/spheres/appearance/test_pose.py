from dataclasses import replace

import numpy as np

from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.spheres.appearance.features import Features, features_of_image, features_of_sphere
from sphere_nav.spheres.appearance.pose import _angles, find_pose, match_features
from worlds.room import optical, sharp_room

MAX_ANGLE = np.radians(1.0)  # written out: imported, a change would go unseen

CAMERA = Spherical(512, 256)
ROOM = sharp_room()
HERE = SE3.exp([0.5, -0.4, 0.0, 0.0, 0.0, 0.0])


def test_a_sphere_is_placed_at_any_heading_and_beside_and_so_is_a_camera():
    turn = 2.6
    motion = SE3.exp([0.4, -0.3, 0.1, 0.0, 0.02, 0.0]) @ SE3.exp([0, 0, 0, 0, 0, turn])
    known = features_of_sphere(ROOM.sphere(HERE, CAMERA, 1))
    found = find_pose(features_of_sphere(ROOM.sphere(HERE @ motion, CAMERA, 2)), known)
    assert found.num_inliers > 30
    distance, angle = found.T_sphere_camera.distance(motion)
    assert distance < 0.05  # rays are good to a third of a pixel of 12 mrad, walls 3 m away
    assert angle < np.radians(1.0)
    lens = Pinhole(400, 300, 250.0, 250.0, 199.5, 149.5)
    T_sphere_camera = optical(SE3.exp([0.2, 0.1, 0.0, 0.0, 0.0, 0.7]))
    image = ROOM.photograph(lens, HERE @ T_sphere_camera)
    found = find_pose(features_of_image(image, lens), known)
    assert found.T_sphere_camera.distance(T_sphere_camera)[0] < 0.1
    assert found.T_sphere_camera.distance(T_sphere_camera)[1] < np.radians(2.0)


def synthetic(num, T_sphere_camera, noise_rad=0.0):
    """Features of a camera and those of a sphere, row by row the same points; descriptors at right angles."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-4.0, 4.0, (num, 3)) + np.array([6.0, 0.0, 0.0])
    seen = T_sphere_camera.inverse().apply(points)
    rays = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    side = np.cross(rays, rng.normal(size=rays.shape))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    rays = np.cos(noise_rad) * rays + np.sin(noise_rad) * side
    range_m = np.linalg.norm(points, axis=1)
    descriptors = (200 * np.eye(num, 128)).astype(np.uint8)
    query = Features(rays.astype(np.float32), np.full(num, np.nan, np.float32), descriptors)
    return query, Features((points / range_m[:, None]).astype(np.float32), range_m.astype(np.float32), descriptors)


def test_a_feature_belongs_to_the_sharpest_match_and_to_none_where_two_are_as_sharp():
    query, known = synthetic(4, SE3.identity())
    descriptors = known.descriptors.copy()
    descriptors[1], descriptors[0, 2] = descriptors[0], 40  # 0 and 1 look alike, 0 not quite as the query
    twins = Features(known.rays, known.range_m, descriptors)
    assert match_features(query, known).tolist() == [[0, 0], [1, 1], [2, 2], [3, 3]]
    assert match_features(query, twins).tolist() == [[0, 1], [2, 2], [3, 3]]
    descriptors[0] = descriptors[1]
    assert match_features(query, twins).tolist() == [[2, 2], [3, 3]]


T_SYNTHETIC = SE3.exp([0.4, -0.7, 0.2, 0.1, -0.2, 0.5])


def test_exact_features_give_the_exact_pose_without_wrong_matches_and_points_without_range():
    query, known = synthetic(40, T_SYNTHETIC)
    rays, range_m = query.rays.copy(), known.range_m.copy()
    rays[:12], range_m[12:16] = rays[11::-1], np.nan
    for pair, number in (((query, known), 40), ((replace(query, rays=rays), replace(known, range_m=range_m)), 24)):
        found = find_pose(*pair)
        np.testing.assert_allclose(found.T_sphere_camera.matrix, T_SYNTHETIC.matrix, atol=1e-5)
        assert found.num_inliers == number


def test_features_that_agree_on_nothing_are_no_pose():
    query, known = synthetic(5, T_SYNTHETIC)
    rays = np.array([[1, 0, 0], [0.6, 0.8, 0], [0.6, -0.8, 0], [0.6, 0, 0.8], [0.6, 0, -0.8]], np.float32)
    far = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0]], np.float32)
    elsewhere = replace(known, rays=far, range_m=np.full(5, 3.0, np.float32))
    assert find_pose(replace(query, rays=rays), elsewhere) is None


def test_a_ray_belongs_to_its_point_within_a_degree():
    for noise_deg, num_inliers in [(0.0, 30), (0.9, 30), (1.1, 24)]:
        query, known = synthetic(30, T_SYNTHETIC)
        noisy, _ = synthetic(30, T_SYNTHETIC, noise_rad=np.radians(noise_deg))
        rays = query.rays.copy()
        rays[:6] = noisy.rays[:6]
        T = T_SYNTHETIC.inverse()
        angles = np.degrees(_angles(T, rays.astype(np.float64), known.points.astype(np.float64)))
        np.testing.assert_allclose(angles[:6], noise_deg, atol=1e-3)
        assert np.sum(np.radians(angles) < MAX_ANGLE) == num_inliers
