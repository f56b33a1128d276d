"""How wrong a map is: by what its key spheres disagree, and by graphs whose covariances are known in closed form."""

import numpy as np
import pytest

from dense_localizer.params import CovarianceParams
from dense_localizer.references.map_error import EdgeErrors, MapError, is_usable, relative_covariances
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import State
from sphere_nav.spheres.graph import Edge, Experience, KeySphere, SphereGraph

SHARED_ERROR, EDGE_ERROR = 2.0, 2.0  # factors of mean squares
PARAMS = CovarianceParams(map_sigma_m=0.002, map_sigma_rad=0.001)
NOISE = np.repeat([0.001, 0.0005], 3) ** 2
HERE = SE3.identity()
LOOSE, TIGHT = 1e-2, 1e-6  # variances of edges
EDGE_HOPS = 5


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


def graph_of(edges, poses=None, experiences=None):
    ids = sorted({end for edge in edges for end in (edge.a, edge.b)})
    poses, experiences = poses or {}, experiences or {}
    nodes = [KeySphere(i, i, poses.get(i, HERE), experience=experiences.get(i, Experience())) for i in ids]
    return SphereGraph(nodes, edges)


def edge(a, b, variance, T=HERE, is_loop=False):
    return Edge(a, b, T, np.eye(6) / variance, is_loop)


def sigma2(edges, sphere_id, **more):
    found = EdgeErrors(graph_of(edges, **more)).covariance(sphere_id)
    return None if found is None else float(found[0, 0])


def test_in_a_chain_errors_add_up_to_all_that_few_edges_reach():
    edges = [edge(0, 1, 1e-4), edge(1, 2, 3e-4), edge(2, 3, 5e-4)]
    assert sigma2(edges, 0) == pytest.approx((1 + 4 + 9) / 3 * 1e-4)
    assert sigma2(edges, 1) == pytest.approx((1 + 3 + 8) / 3 * 1e-4)
    assert sigma2(edges, 2) == pytest.approx((4 + 3 + 5) / 3 * 1e-4)
    far = [edge(k, k + 1, 1e-4) for k in range(EDGE_HOPS + 3)]
    assert sigma2(far, 0) == pytest.approx((EDGE_HOPS + 1) / 2 * 1e-4)


def test_a_wide_edge_is_as_sure_as_the_way_around_it():
    around = [edge(0, 2, TIGHT), edge(2, 3, TIGHT), edge(3, 1, TIGHT)]
    expected = 1 / (1 / LOOSE + 1 / (3 * TIGHT))
    motions = relative_covariances(*graph_and_edges([edge(0, 1, LOOSE), *around]), 0)
    np.testing.assert_allclose(np.diagonal(motions[1]), expected, rtol=1e-6)
    assert sigma2([edge(0, 1, LOOSE)], 0) == pytest.approx(LOOSE)


def test_a_refuted_loop_makes_nothing_sure():
    wrong = edge(0, 1, TIGHT, SE3.from_planar(0.01, 0.0, 0.0), is_loop=True)  # ten standard deviations off
    right = edge(0, 1, TIGHT, SE3.from_planar(0.004, 0.0, 0.0), is_loop=True)
    assert not is_usable(graph_of([wrong]), wrong)
    assert is_usable(graph_of([right]), right)
    assert is_usable(graph_of([wrong]), edge(0, 1, TIGHT, SE3.from_planar(0.01, 0.0, 0.0)))  # of the drive itself
    assert sigma2([edge(0, 1, LOOSE), wrong], 0) == pytest.approx(LOOSE)
    assert sigma2([edge(0, 1, LOOSE), right], 0) == pytest.approx(TIGHT, rel=1e-3)


@pytest.mark.parametrize(
    "lost",
    [edge(1, 2, TIGHT, SE3.from_planar(1.0, 0.0, 0.0), is_loop=True), Edge(1, 2, HERE, np.diag([1.0, 1, 1, 1, 1, 0]))],
    ids=["refuted", "singular"],
)
def test_a_key_sphere_that_nothing_holds_makes_the_others_no_surer(lost):
    assert sigma2([edge(0, 1, LOOSE), lost], 0) == pytest.approx(LOOSE)


def test_around_a_loop_information_is_that_of_numerical_derivatives():
    rng = np.random.default_rng(5)
    poses = {k: SE3.exp(rng.normal(size=6) * 0.8) for k in range(4)}
    edges = []
    for a, b in ((0, 1), (1, 2), (2, 3), (1, 3)):
        root = rng.normal(size=(6, 6))
        edges.append(Edge(a, b, poses[a].inverse() @ poses[b], root @ root.T + np.eye(6), is_loop=b - a > 1))

    def residuals(x):
        at = {0: poses[0]} | {k: poses[k] @ SE3.exp(x[6 * k - 6 : 6 * k]) for k in (1, 2, 3)}
        return [(one.T_a_b.inverse() @ at[one.a].inverse() @ at[one.b]).log() for one in edges]

    step, information = 1e-6, np.zeros((18, 18))
    J = np.array([np.subtract(residuals(step * e), residuals(-step * e)) / (2 * step) for e in np.eye(18)])
    for k, one in enumerate(edges):
        information += J[:, k] @ one.information @ J[:, k].T
    motions = relative_covariances(*graph_and_edges(edges, poses), 0)
    covariance = np.linalg.inv(information)
    for k in (1, 2, 3):
        at = slice(6 * k - 6, 6 * k)
        np.testing.assert_allclose(motions[k], covariance[at, at], rtol=1e-6, atol=1e-9)


def test_an_error_of_a_turned_key_sphere_lies_along_its_axes():
    turned = SE3.from_planar(0.0, 0.0, np.pi / 2)
    variance = np.array([1e-4, 4e-6, 1e-6, 1e-6, 1e-6, 4e-6])
    one = EdgeErrors(graph_of([Edge(0, 1, turned, np.diag(1 / variance))], {1: turned}))
    np.testing.assert_allclose(np.diagonal(one.covariance(0)), variance[[1, 0, 2, 4, 3, 5]], rtol=1e-9)


def graph_and_edges(edges, poses=None):
    edges_of = {}
    for one in edges:
        edges_of.setdefault(one.a, []).append(one)
        edges_of.setdefault(one.b, []).append(one)
    return graph_of(edges, poses), edges_of
