"""Does a survey agree with what was aligned? The motions between key spheres are known from both."""

from __future__ import annotations

import numpy as np

from sphere_nav.estimation.gates import squared_mahalanobis
from sphere_nav.ros.bags import BagError
from sphere_nav.spheres.graph import Edge, SphereGraph

# Standard deviations that are granted to a survey (m, rad), and the factor on those of the edges: on real recordings
# with good truth edges err about twice as much as they say.
SURVEY_SIGMA = np.repeat([0.01, np.radians(0.3)], 3)
EDGE_FACTOR = 2.0
MAX_SIGMAS = 5.3  # of six degrees of freedom together: an edge in 10,000 by chance
MAX_CONTRADICTED = 0.5  # share of the edges above which the survey is refused
NUM_NAMED = 3


def check_survey(aligned: SphereGraph, surveyed: SphereGraph, source: str) -> list[str]:
    """Compare the aligned edges with the surveyed poses of the same key spheres; return warnings, worst edges by name.

    BagError where most edges contradict the survey: the poses are wrong, of another frame or of other stamps.
    """
    found = sorted(((_sigmas(edge, surveyed), edge) for edge in aligned.edges), key=lambda pair: pair[0], reverse=True)
    wrong = [(sigmas, edge) for sigmas, edge in found if sigmas > MAX_SIGMAS]
    if not wrong:
        return []
    named = "; ".join(_describe(edge, sigmas, surveyed) for sigmas, edge in wrong[:NUM_NAMED])
    what = f"{len(wrong)} of {len(found)} motions between key spheres contradict the survey: {named}"
    if len(wrong) > MAX_CONTRADICTED * len(found):
        raise BagError(f"{source}: expected surveyed poses that agree with the images, found {what}")
    return [f"warning: {what}"]


def _sigmas(edge: Edge, surveyed: SphereGraph) -> float:
    """Return how far the survey is from an edge in standard deviations of both."""
    T_a_b = surveyed[edge.a].T_map_sphere.inverse() @ surveyed[edge.b].T_map_sphere
    xi = (edge.T_a_b.inverse() @ T_a_b).log()
    covariance = EDGE_FACTOR**2 * np.linalg.pinv(edge.information) + np.diag(SURVEY_SIGMA**2)
    return float(np.sqrt(squared_mahalanobis(xi, covariance)))


def _describe(edge: Edge, sigmas: float, surveyed: SphereGraph) -> str:
    T_a_b = surveyed[edge.a].T_map_sphere.inverse() @ surveyed[edge.b].T_map_sphere
    meters, radians = edge.T_a_b.distance(T_a_b)
    return f"{edge.a} to {edge.b} by {1e3 * meters:.0f} mm, {np.degrees(radians):.2f} deg ({sigmas:.1f} sigma)"
