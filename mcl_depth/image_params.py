"""Parameters of the image side: what is synthesised and how it is compared."""

from __future__ import annotations

from sphere_nav.params import param, parameters


@parameters
class SynthesisParams:
    """Depth panoramas from the map (N17 section III-A)."""

    num_columns: int = param(180, "columns of the panorama, all around", low=32, high=4096)
    elevation_min_deg: float = param(-42.5, "lowest elevation of the panorama", "deg", low=-90.0, high=90.0)
    elevation_max_deg: float = param(42.5, "highest elevation of the panorama", "deg", low=-90.0, high=90.0)
    voxel_m: float = param(0.1, "finest spacing of the points of a cloud; they grow coarser with range", "m", low=1e-3)
    max_range_m: float = param(200.0, "range beyond which points are not drawn", "m", low=1.0)


@parameters
class ComparisonParams:
    """Gradient features of depth images (N17 section III-B)."""

    is_sky_far: bool = param(False, "unknown pixels above all known ones of their column are far, not interpolated")
