"""READ FIRST: all poses corrected so that every measured motion fits as well as it can (M15 section 3.5.2).

Levenberg-Marquardt ends in whatever valley it starts in. So it starts from the chordal solution, which needs no guess
(Carlone et al. 2015); only where that does not fit the given poses are tried, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import gtsam
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sphere_mapping.constants import ANCHOR_SIGMA, DESCENT_TOLERANCE, ROBUST_WIDTH
from sphere_nav.estimation.least_squares import gate
from sphere_nav.geometry import SE3
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph

ANGLE_FIRST = np.ix_([3, 4, 5, 0, 1, 2], [3, 4, 5, 0, 1, 2])  # our (v, omega) in GTSAM's order (omega, v)


class Descent(NamedTuple):
    """Where a descent ended: poses by row, and the weighted sum of squares of the edges there."""

    values: gtsam.Values
    chi2: float


def optimize_map(graph: SphereGraph) -> SphereGraph:
    """Return the map at the poses that fit its edges best; the first of connected key spheres stays.

    Wrong loops spoil the chordal start, which is not robust, and drift spoils the given one. Where the first leads to
    poses that fit all edges within their noise there is nothing to be gained by the other.
    """
    if not graph.edges:
        return graph
    row = {node.id: number for number, node in enumerate(graph)}
    edges, anchors = factors_of(graph.edges, row), anchors_of(graph)
    anchored = gtsam.NonlinearFactorGraph(edges)
    hold(anchored, anchors, row)
    best = descend(anchored, edges, lambda: gtsam.InitializePose3.initialize(anchored))
    if best is None or not fits(best.chi2, len(graph.edges) - len(graph) + len(anchors)):
        given = descend(anchored, edges, lambda: values_of(graph, row))
        if best is None or (given is not None and best.chi2 > given.chi2):
            best = given
    if best is None:
        raise ValueError("pose graph: expected edges that determine all poses, found a system without a solution")
    poses = SE3.from_matrix(np.array([best.values.atPose3(number).matrix() for number in range(len(graph))]))
    return graph.with_poses({node_id: poses[number] for node_id, number in row.items()})


def descend(
    anchored: gtsam.NonlinearFactorGraph, edges: gtsam.NonlinearFactorGraph, start: Callable[[], gtsam.Values]
) -> Descent | None:
    """Return where Levenberg-Marquardt ends from a start, None where it breaks down; GTSAM's error is half of chi2."""
    settings = gtsam.LevenbergMarquardtParams()
    settings.setRelativeErrorTol(DESCENT_TOLERANCE)
    settings.setAbsoluteErrorTol(0.0)
    try:
        values = gtsam.LevenbergMarquardtOptimizer(anchored, start(), settings).optimize()
    except RuntimeError:  # an indeterminate system: the start was hopeless
        return None
    chi2 = float(2.0 * edges.error(values))
    return Descent(values, chi2) if np.isfinite(chi2) else None


def anchors_of(graph: SphereGraph) -> list[KeySphere]:
    """Return the key spheres that stay where they are: the first one of every connected part."""
    nodes = list(graph)
    row = {node.id: number for number, node in enumerate(nodes)}
    a, b = np.array([(row[edge.a], row[edge.b]) for edge in graph.edges]).T
    joined = coo_array((np.ones(len(a)), (a, b)), shape=(len(nodes), len(nodes)))
    _, parts = connected_components(joined, directed=False)
    return [nodes[number] for number in np.unique(parts, return_index=True)[1]]


def fits(chi2: float, num_free: int) -> bool:
    """Say whether edges that are as good as they say would leave as much as this: in all but one of a thousand maps.

    num_free: edges more than poses need.
    """
    return chi2 <= (gate(6 * num_free) if num_free else 0.0)


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
