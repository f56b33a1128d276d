"""When a sphere becomes a key sphere: as late as possible, to drift as little as possible (M15 section 3.5.1).

What the mapper says of every sphere, and what it keeps of those that are no key spheres.
"""

from __future__ import annotations

from dataclasses import dataclass

from sphere_mapping.constants import MIN_INLIER_SHARE
from sphere_mapping.graph.registration import PreparedSphere
from sphere_mapping.params import KeySphereParams
from sphere_nav.geometry import SE3
from sphere_nav.photometric import Alignment

NOT_YET, FIRST, MAD, OVERLAP, INLIERS, PARALLAX = "", "FIRST", "MAD", "OVERLAP", "INLIERS", "PARALLAX"


@dataclass(frozen=True, eq=False)
class MapUpdate:
    """What one sphere changed. T_map_sphere is None where the sphere could not be placed; `alignment` says why."""

    stamp_ns: int
    T_map_sphere: SE3 | None
    alignment: Alignment | None = None
    key_reason: str = NOT_YET

    @property
    def is_key(self) -> bool:
        """Whether the sphere became a key sphere."""
        return self.key_reason != NOT_YET


@dataclass(frozen=True, eq=False)
class Track:
    """A placed sphere by its reference, so that its pose follows when the graph is corrected."""

    stamp_ns: int
    key_id: int
    T_key_sphere: SE3


def why_key_sphere(
    alignment: Alignment, T_reference_sphere: SE3, reference: PreparedSphere, params: KeySphereParams
) -> str:
    """Return why a sphere aligned with a reference must become the next one, or `NOT_YET`.

    Eq. 12 on whole spheres; a partial sphere also loses sight of its reference, and one that drives into its view
    sees everything larger long before the residual says so. Overlap is counted of what has a range and could overlap.
    """
    if alignment.mad > params.max_mad_share * 255.0:
        return MAD
    if alignment.overlap < params.min_overlap * reference.coverage:
        return OVERLAP
    if alignment.inlier_share < MIN_INLIER_SHARE:
        return INLIERS
    distance, _ = SE3.identity().distance(T_reference_sphere)
    if distance > reach(reference, params):
        return PARALLAX
    return NOT_YET


def reach(reference: PreparedSphere, params: KeySphereParams) -> float:
    """Return how far from a reference in m the next key sphere is at the latest."""
    max_parallax = params.max_parallax_whole if reference.is_whole else params.max_parallax
    return max_parallax * reference.median_range
