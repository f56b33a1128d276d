"""What the calibration may be told."""

from __future__ import annotations

from sphere_nav.estimation.robust import HUBER
from sphere_nav.params import param, parameters


@parameters
class CalibrationParams:
    """Rejection of false corners, what is held out, and from where on a warning is given."""

    num_distortion: int = param(5, "distortion coefficients of a pinhole: 0, 4, 5 or 8", low=0, high=8)
    huber_width: float = param(HUBER, "residual beyond which its weight falls", "standard deviations", low=0.5)
    corner_limit: float = param(5.0, "residual beyond which a corner is left out", "standard deviations", low=2.0)
    view_ratio: float = param(
        4.0, "median residual of a view, by that of its camera, beyond which it is left out", "x", low=1.5
    )
    min_residual_px: float = param(0.1, "residual below which no corner is left out", "px", low=0.0)
    min_corners: int = param(8, "corners that a view must have", low=6)
    min_views: int = param(4, "views that a camera must have", low=2)
    held_out_every: int = param(4, "every how many instants one is held out to judge by", low=2)
    max_position_std_m: float = param(
        0.005, "standard deviation of a camera's position that is worth a warning", "m", low=0.0
    )
    max_rotation_std_deg: float = param(
        0.1, "standard deviation of a camera's rotation that is worth a warning", "deg", low=0.0
    )
