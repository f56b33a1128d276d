"""READ FIRST: all poses corrected so that every measured motion fits as well as it can (M15 section 3.5.2).

Levenberg-Marquardt ends in whatever valley it starts in. So it starts from the chordal solution, which needs no guess
(Carlone et al. 2015); only where that does not fit the given poses are tried, too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import gtsam
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.special import chdtri

from sphere_mapping.constants import COST_TOLERANCE, DESCENT_TOLERANCE, MAX_STEPS, TOO_MUCH
from sphere_mapping.graph.factors import factors_of, hold, values_of
from sphere_nav.geometry import SE3
from sphere_nav.spheres.graph import KeySphere, SphereGraph


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
        if best is None or (given is not None and best.chi2 > given.chi2 * (1 + COST_TOLERANCE)):
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
    settings.setMaxIterations(MAX_STEPS["descent"])
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
    return chi2 <= (float(chdtri(6 * num_free, TOO_MUCH)) if num_free else 0.0)
