"""READ FIRST: all poses corrected so that every measured motion fits as well as it can (M15 section 3.5.2).

Levenberg-Marquardt ends in whatever valley it starts in. So it starts from the chordal solution, which needs no guess;
only where that does not fit the given poses are tried, too.
"""

from __future__ import annotations

from dataclasses import dataclass

from scipy.special import chdtri

from sphere_mapping.constants import COST_TOLERANCE, TOO_MUCH
from sphere_mapping.graph.factors import DescentResult, chi2_of, factors_of, minimize_poses, values_of
from sphere_mapping.graph.pose_graph import PoseGraph, from_spheres, to_spheres
from sphere_nav.geometry.arrays import Array
from sphere_nav.spheres.graph import SphereGraph

GIVEN, CHORDAL = "given", "chordal"


@dataclass(frozen=True, eq=False)
class Optimum:
    """Poses (N, 4, 4) that fit best, and what is known about them.

    chi2_before, chi2_after: weighted sum of squares at the given poses and at these.
    start: where the descent that won began; solutions: where each of them ended.
    """

    poses: Array
    chi2_before: float
    chi2_after: float
    iterations: int
    start: str
    solutions: dict[str, DescentResult]


@dataclass(frozen=True, eq=False)
class CorrectedMap:
    """The map at its corrected poses, and how they were found (None for a map without edges)."""

    graph: SphereGraph
    optimum: Optimum | None


def optimize_map(graph: SphereGraph) -> CorrectedMap:
    """Return the map at the poses that fit its edges best; the first key sphere stays, loop edges are robust.

    Wrong loops spoil the chordal start, which is not robust, and drift spoils the given one. Where the first leads to
    poses that fit all edges within their noise there is nothing to be gained by the other.
    """
    if not graph.edges:
        return CorrectedMap(graph, None)
    problem = from_spheres(graph)
    factors = factors_of(problem)
    solutions = {CHORDAL: minimize_poses(factors, problem)}
    if not fits(problem, solutions[CHORDAL]):
        solutions[GIVEN] = minimize_poses(factors, problem, values_of(problem))
    optimum = _best(solutions, chi2_of(factors, values_of(problem)))
    return CorrectedMap(to_spheres(graph, optimum.poses), optimum)


def fits(graph: PoseGraph, solution: DescentResult | None) -> bool:
    """Say whether edges that are as good as they say would leave as much as this: in all but one of a thousand maps."""
    num_free = len(graph.ends) - len(graph.ids) + len(graph.anchors)  # edges more than poses need
    limit = chdtri(6 * num_free, TOO_MUCH) if num_free else 0.0
    return solution is not None and solution.chi2 <= limit


def _best(solutions: dict[str, DescentResult | None], chi2_before: float) -> Optimum:
    found = {name: solution for name, solution in solutions.items() if solution is not None}
    if not found:
        raise ValueError("pose graph: expected edges that determine all poses, found a system without a solution")
    lowest = min(solution.chi2 for solution in found.values())
    start, best = next(item for item in found.items() if item[1].chi2 <= lowest * (1 + COST_TOLERANCE))
    return Optimum(best.poses, chi2_before, best.chi2, best.iterations, start, found)
