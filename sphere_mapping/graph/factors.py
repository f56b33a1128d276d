"""Edges of a map as factors of GTSAM."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import gtsam
import numpy as np

from sphere_mapping.constants import ANCHOR_SIGMA, ROBUST_WIDTH
from sphere_nav.spheres.graph import Edge, KeySphere

ANGLE_FIRST = np.ix_([3, 4, 5, 0, 1, 2], [3, 4, 5, 0, 1, 2])  # our (v, omega) in GTSAM's order (omega, v)


def factors_of(edges: Iterable[Edge], row: Mapping[int, int]) -> gtsam.NonlinearFactorGraph:
    """Return an edge's error as log(T_measured^-1 T_a^-1 T_b) with its full information; edges of loops are robust.

    `row` is the number that the solver has for a key sphere.
    """
    factors = gtsam.NonlinearFactorGraph()
    huber = gtsam.noiseModel.mEstimator.Huber.Create(ROBUST_WIDTH)
    for edge in edges:
        noise: gtsam.noiseModel.Base = gtsam.noiseModel.Gaussian.Information(edge.information[ANGLE_FIRST])
        noise = gtsam.noiseModel.Robust.Create(huber, noise) if edge.is_loop else noise
        factors.add(gtsam.BetweenFactorPose3(row[edge.a], row[edge.b], gtsam.Pose3(edge.T_a_b.matrix), noise))
    return factors


def hold(factors: gtsam.NonlinearFactorGraph, nodes: Iterable[KeySphere], row: Mapping[int, int]) -> None:
    """Add what holds key spheres where they are."""
    noise = gtsam.noiseModel.Isotropic.Sigma(6, ANCHOR_SIGMA)
    for node in nodes:
        factors.add(gtsam.PriorFactorPose3(row[node.id], gtsam.Pose3(node.T_map_sphere.matrix), noise))


def values_of(nodes: Iterable[KeySphere], row: Mapping[int, int]) -> gtsam.Values:
    """Return the poses of key spheres as GTSAM has them."""
    values = gtsam.Values()
    for node in nodes:
        values.insert(row[node.id], gtsam.Pose3(node.T_map_sphere.matrix))
    return values
