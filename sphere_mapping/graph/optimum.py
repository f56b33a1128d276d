"""READ FIRST: all poses corrected so that every measured motion fits as well as it can (M15 section 3.5.2).

Levenberg-Marquardt ends in whatever valley it starts in. So it starts from the chordal solution, which needs no guess,
and a certificate says whether a better optimum can exist; only where it says nothing the given poses are tried, too.
"""

from __future__ import annotations

from dataclasses import dataclass

from scipy.special import chdtri

from sphere_mapping.constants import CERTIFICATE_TOLERANCE, COST_TOLERANCE, TOO_MUCH
from sphere_mapping.graph.certificate import ChordalOptimum, certify
from sphere_mapping.graph.chordal import chordal_poses
from sphere_mapping.graph.factors import DescentResult, chi2_of, factors_of, minimize_poses
from sphere_mapping.graph.pose_graph import TANGENT_SIZE, PoseGraph, from_spheres, to_spheres
from sphere_nav.geometry.arrays import Array
from sphere_nav.spheres.graph import SphereGraph

GIVEN, CHORDAL, CERTIFIED = "given", "chordal", "certified"


@dataclass(frozen=True, eq=False)
class Optimum:
    """Poses (N, d + 1, d + 1) that fit best, and what is known about them.

    chi2_before, chi2_after: weighted sum of squares at the given poses and at these.
    start: where the descent that won began; solutions: where each of them ended.
    certificate: of the chordal cost nearby; None where nobody asked.
    """

    poses: Array
    chi2_before: float
    chi2_after: float
    iterations: int
    start: str
    solutions: dict[str, DescentResult]
    certificate: ChordalOptimum | None = None

    @property
    def doubt(self) -> str:
        """Why a better optimum may exist, in words; empty where none is expected."""
        if self.certificate is not None:
            return "" if self.certificate.is_global else "no certificate: a better optimum may exist"
        away = [
            name for name, found in self.solutions.items() if found.chi2 > self.chi2_after * (1 + CERTIFICATE_TOLERANCE)
        ]
        return f"the {away[0]} start ended at {self.solutions[away[0]].chi2:.6g}" if away else ""


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
    solutions = {CHORDAL: minimize_poses(factors, problem, chordal_poses(problem))}
    if not fits(problem, solutions[CHORDAL]):
        solutions[GIVEN] = minimize_poses(factors, problem, problem.poses)
    optimum = _best(solutions, chi2_of(factors, problem, problem.poses))
    return CorrectedMap(to_spheres(graph, optimum.poses), optimum)


def optimize(graph: PoseGraph) -> Optimum:
    """Return the best optimum found and its certificate; ValueError where every descent broke down.

    The certificate is one of the chordal cost with isotropic precisions, not of chi2 itself: from its optimum a last
    descent leads to the optimum of chi2 next to it.
    """
    factors = factors_of(graph)
    chi2_before = chi2_of(factors, graph, graph.poses)
    first = chordal_poses(graph)
    chordal = minimize_poses(factors, graph, first)
    solutions = {CHORDAL: chordal}
    certificate = certify(graph, first if chordal is None else chordal.poses)
    solutions[CERTIFIED] = minimize_poses(factors, graph, certificate.poses)
    if not certificate.is_global:
        solutions[GIVEN] = given = minimize_poses(factors, graph, graph.poses)
        if given is not None:
            certificate = min(certificate, certify(graph, given.poses), key=lambda it: (not it.is_global, it.cost))
    return _best(solutions, chi2_before, certificate)


def fits(graph: PoseGraph, solution: DescentResult | None) -> bool:
    """Say whether edges that are as good as they say would leave as much as this: in all but one of a thousand maps."""
    num_free = len(graph.ends) - len(graph.ids) + len(graph.anchors)  # edges more than poses need
    limit = chdtri(TANGENT_SIZE[graph.dimension] * num_free, TOO_MUCH) if num_free else 0.0
    return solution is not None and solution.chi2 <= limit


def _best(
    solutions: dict[str, DescentResult | None], chi2_before: float, certificate: ChordalOptimum | None = None
) -> Optimum:
    found = {name: solution for name, solution in solutions.items() if solution is not None}
    if not found:
        raise ValueError("pose graph: expected edges that determine all poses, found a system without a solution")
    lowest = min(solution.chi2 for solution in found.values())
    start, best = next(item for item in found.items() if item[1].chi2 <= lowest * (1 + COST_TOLERANCE))
    return Optimum(best.poses, chi2_before, best.chi2, best.iterations, start, found, certificate)
