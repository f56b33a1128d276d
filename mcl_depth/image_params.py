"""Parameters of the image side: what is synthesised and how it is compared."""

from __future__ import annotations

from typed_params import param, parameters


@parameters
class SynthesisParams:
    """Depth panoramas from the map (N17 section III-A)."""

    num_columns: int = param(360, "columns of the panorama, all around", low=32, high=4096)
    elevation_min_deg: float = param(-42.5, "lowest elevation of the panorama", "deg", low=-90.0, high=90.0)
    elevation_max_deg: float = param(42.5, "highest elevation of the panorama", "deg", low=-90.0, high=90.0)
    voxel_m: float = param(0.1, "finest spacing of the points of a cloud; they grow coarser with range", "m", low=1e-3)
    splat: float = param(1.5, "width of a drawn point by the spacing of the points, so that surfaces close", low=0.1)
    coarseness: float = param(1.0, "spacing of the points that are drawn, at most, by the width of a pixel", low=0.1)
    min_range_m: float = param(0.2, "range below which points are not drawn", "m", low=0.0)
    max_range_m: float = param(200.0, "range beyond which points are not drawn", "m", low=1.0)
    drawing: str = param(
        "auto",
        "how points become surfaces: columns of voxels where they are dense, splats where they are single; auto: by"
        " their density",
        choices=("auto", "columns", "splats"),
    )


@parameters
class ComparisonParams:
    """Gradient features of both images and their normalisation (N17 section III-B)."""

    lcn_radius_px: int = param(10, "radius k of the local contrast normalisation; 0: none", "px", low=0, high=200)
    normalisation: str = param(
        "both",
        "gradient magnitudes that sum to 1: those of both images, or of the visual one only (the paper's words)",
        choices=("both", "literal"),
    )
    depth_scale: str = param("range", "what depth gradients are taken of", choices=("range", "log", "inverse"))
    num_blurs: int = param(0, "passes of a 3 x 3 binomial filter over both images", low=0, high=50)
    min_sigma: float = param(1e-3, "smallest standard deviation that contrast is divided by", low=1e-9)
    is_sky_far: bool = param(False, "unknown pixels above all known ones of their column are far, not interpolated")
    far_m: float = param(100.0, "range given to what is far", "m", low=1.0)
