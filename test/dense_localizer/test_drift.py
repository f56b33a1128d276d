"""The covariance of a way by the map: that of its edges, summed as motions are, none where the camera stands."""

from itertools import pairwise

import numpy as np
import pytest

from dense_localizer.motion_prior import MapDrift, estimate_drift_rate
from sphere_nav.geometry import SE3
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph

SIGMA = np.repeat([0.004, 0.002], 3)


def graph_of(poses) -> SphereGraph:
    edges = [Edge(k, k + 1, a.inverse() @ b, np.diag(1.0 / SIGMA**2)) for k, (a, b) in enumerate(pairwise(poses))]
    return SphereGraph([KeySphere(k, 1 + k, pose) for k, pose in enumerate(poses)], edges)


def test_a_meter_errs_as_the_edges_say():
    assert estimate_drift_rate(SphereGraph([])) == pytest.approx(np.repeat([0.002, 0.0015], 3) ** 2)
    graph = graph_of([SE3.from_planar(2.0 * k, 0.0, 0.0) for k in range(4)])
    np.testing.assert_allclose(estimate_drift_rate(graph), 2.0 * SIGMA**2 / 2.0)


def test_drift_is_as_large_as_that_of_random_maps():
    poses = [SE3.from_planar(1.0 * k, 0.05 * k * k, 0.1 * k) for k in range(9)]
    drift, rng = MapDrift(graph_of(poses)), np.random.default_rng(2)
    drift.start(poses[0])
    for pose in poses[1:]:
        drift.propagate(pose)
    steps, sigma = [a.inverse() @ b for a, b in pairwise(poses)], np.sqrt(drift.per_meter)
    T = poses[0]
    for step in steps:
        T = T @ step @ SE3.exp(rng.normal(0, sigma * np.sqrt(np.linalg.norm(step.translation)), (4000, 6)))
    ends = (poses[-1].inverse() @ T).log()
    np.testing.assert_allclose(drift.covariance, np.cov(ends.T), atol=0.1 * drift.covariance.max())


def test_standing_still_adds_nothing_and_a_start_forgets():
    drift = MapDrift(graph_of([SE3.identity(), SE3.from_planar(1.0, 0.0, 0.0)]))
    drift.start(SE3.identity())
    drift.propagate(SE3.from_planar(3.0, 0.0, 0.0))
    before = drift.covariance
    for _ in range(5):
        drift.propagate(SE3.from_planar(3.0, 0.0, 0.0))
    np.testing.assert_array_equal(drift.covariance, before)
    assert before[0, 0] > 0.0
    drift.start(SE3.identity())
    assert not drift.covariance.any()
