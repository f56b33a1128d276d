import numpy as np
import pytest

from dense_localizer.params import CovarianceParams
from dense_localizer.references.map_error import MapError
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import State
from sphere_nav.spheres.graph import Edge, Experience, KeySphere, SphereGraph

SHARED_ERROR, EDGE_ERROR = 2.0, 2.0  # factors of mean squares
PARAMS = CovarianceParams(map_sigma_m=0.002, map_sigma_rad=0.001)
NOISE = np.repeat([0.001, 0.0005], 3) ** 2


def test_a_good_map_makes_the_pose_surer_as_it_is_driven():
    error, rng = MapError(SphereGraph(), PARAMS), np.random.default_rng(1)
    at_first = np.sqrt(np.diagonal(error.covariance(0, SE3.identity())) / SHARED_ERROR)
    np.testing.assert_allclose(at_first, np.repeat([0.002, 0.001], 3))
    sigma = np.repeat([0.01, 0.003], 3)
    seen = []
    for _ in range(400):
        error.add(rng.normal(size=6) * np.hypot(sigma, np.sqrt(NOISE)), NOISE)
        seen.append(np.diagonal(error.covariance(0, SE3.identity())) / SHARED_ERROR)
    np.testing.assert_allclose(np.sqrt(np.mean(seen[50:], axis=0)), sigma, rtol=0.15)


@pytest.mark.parametrize("size", [0.0, 1.0])
def test_a_pose_is_as_far_off_as_is_told(size):
    sigma, nees = size * np.sqrt(NOISE), []
    for seed in range(20):
        error, rng = MapError(SphereGraph(), PARAMS), np.random.default_rng(seed)
        for k in range(60):
            error.add(rng.normal(size=6) * np.hypot(sigma, np.sqrt(NOISE)), NOISE)
            if k >= 10:
                told = np.diagonal(error.covariance(0, SE3.identity())) / SHARED_ERROR + NOISE
                nees.append(np.sum((sigma**2 + NOISE) / told))
    assert 3.0 < np.mean(nees) < 9.0


def test_one_wrong_image_does_not_make_the_map_wrong():
    error, rng = MapError(SphereGraph(), PARAMS), np.random.default_rng(3)
    for _ in range(30):
        error.add(rng.normal(size=6) * np.repeat([0.004, 0.002], 3), NOISE)
    before = np.diagonal(error.covariance(0, SE3.identity())).copy()
    error.add(np.ones(6), NOISE)  # a metre: something stood before the camera
    assert np.all(np.diagonal(error.covariance(0, SE3.identity())) < 3.0 * before)


@pytest.mark.slow
def test_a_map_once_thought_wrong_is_trusted_again(room, room_map):
    from worlds.localizer import Run, drive, make_localizer

    localizer = make_localizer(room_map)
    for _ in range(40):
        localizer.references.error.add(np.repeat([0.3, 0.03], 3), NOISE)  # so wrong that every image is refused
    assert localizer.references.error.covariance(0, SE3.identity())[0, 0] > 0.2**2
    run = Run(room, localizer)
    states = (run.see(pose).status.state for pose in drive(55))
    assert next(states) is State.SEARCHING
    assert State.TRACKING in states


def test_edges_tell_their_errors_in_the_axes_of_the_camera():
    nodes = [KeySphere(i, i, SE3.from_planar(i, 0, 0.4 * i)) for i in range(3)]
    variance = np.array([1e-4, 4e-6, 1e-6, 1e-6, 1e-6, 4e-6])
    edge = Edge(0, 1, nodes[1].T_map_sphere, np.diag(1 / variance))
    error = MapError(SphereGraph(nodes, [edge]), CovarianceParams(map_sigma_m=0.0, map_sigma_rad=0.0))
    T_sphere_camera = SE3.from_planar(0.3, 0.1, 0.6)
    R = np.kron(np.eye(2), nodes[1].T_map_sphere.rotation.T @ T_sphere_camera.rotation)
    found = R @ error.covariance(0, T_sphere_camera) @ R.T
    np.testing.assert_allclose(found, EDGE_ERROR * np.diag(variance), atol=1e-12)
    assert not error.covariance(2, T_sphere_camera).any()


def test_a_drive_that_was_added_uncertain_leaves_the_map_as_certain_as_it_was():
    first, later = Experience("day"), Experience("night")
    nodes = [KeySphere(i, i, SE3.from_planar(i, 0, 0), experience=later if i > 1 else first) for i in range(4)]
    edges = [
        Edge(a, b, SE3.from_planar(1, 0, 0), np.eye(6) / variance)
        for a, b, variance in [(0, 1, 1e-6), (2, 1, 1e-2), (2, 3, 9e-6)]
    ]
    error = MapError(SphereGraph(nodes, edges), CovarianceParams(map_sigma_m=0.0, map_sigma_rad=0.0))
    found = [error.covariance(i, SE3.identity())[0, 0] / EDGE_ERROR for i in range(4)]
    np.testing.assert_allclose(found, [1e-6, 1e-6, (2e-2 + 1e-6 + 9e-6) / 3, (2e-2 + 1e-6 + 27e-6) / 3])


@pytest.mark.slow
@pytest.mark.parametrize("shift_m", [0.0, 0.02])
def test_misplaced_key_spheres_widen_the_covariance(room, room_map, shift_m):
    from worlds.localizer import MemoryMap, Run, at, make_localizer

    wrong = MemoryMap(room_map.graph.with_poses({2: SE3.from_planar(0.0, shift_m, 0.0)}))
    run = Run(room, make_localizer(wrong))
    estimates = run.follow([at(-0.9 + 0.02 * k, 0.0, 0.3) for k in range(40)])
    sigma = np.sqrt(np.max(np.diagonal(estimates[-1].covariance)[:3]))
    assert (sigma > 0.006) == (shift_m > 0.0)
