"""When a sphere becomes a key sphere: as late as possible, to drift as little as possible (M15 section 3.5.1)."""

from __future__ import annotations

from photometric import Alignment
from sphere_geometry import SE3
from sphere_mapping.params import KeySphereParams

MAX_GREY = 255.0

NOT_YET, FIRST, MAD, OVERLAP, INLIERS, DISTANCE, LAST_GOOD = (
    "", "FIRST", "MAD", "OVERLAP", "INLIERS", "DISTANCE", "LAST_GOOD"
)  # fmt: skip


def why_key_sphere(alignment: Alignment, T_reference_sphere: SE3, coverage: float, params: KeySphereParams) -> str:
    """Return why a sphere aligned with a reference must become the next one, or `NOT_YET`.

    Eq. 12 on whole spheres; a partial sphere also loses sight of its reference. coverage is the share of the
    reference's image that has a range, so that overlap is counted of what could overlap.
    """
    if alignment.mad > params.max_mad_share * MAX_GREY:
        return MAD
    if alignment.overlap < params.min_overlap * coverage:
        return OVERLAP
    if alignment.inlier_share < params.min_inlier_share:
        return INLIERS
    distance, _ = SE3.identity().distance(T_reference_sphere)
    if 0 < params.max_distance_m < distance:
        return DISTANCE
    return NOT_YET
