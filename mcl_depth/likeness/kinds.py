"""How an image is compared with depth images: by gradients, or by what was learned. The map asks one of the two."""

from __future__ import annotations

from typing import Any

from mcl_depth.likeness.gradients import Gradients
from mcl_depth.likeness.learned import Learned, load_encoders
from mcl_depth.params import FilterParams
from sphere_nav.geometry import Spherical

Likeness = Gradients | Learned
Visual = Any  # what `Likeness.image` makes of an image


def check_headings(params: FilterParams) -> None:
    """Refuse a step between headings that is no whole number of columns, or does not divide a circle; ValueError."""
    step_deg, num_columns = params.heading_step_deg, params.synthesis.num_columns
    if num_columns % params.num_headings or abs(params.num_headings * step_deg - 360.0) > 1e-6:
        expected = f"a divisor of 360 deg and a multiple of a column, {360.0 / num_columns:g} deg"
        raise ValueError(f"heading_step_deg: expected {expected}, found {step_deg:g} deg")


def check_likeness(params: FilterParams) -> None:
    """Refuse panoramas that the encoders were not trained for, where they are asked for; ValueError."""
    found = params.synthesis.num_columns
    if params.likeness.kind == "learned" and found != load_encoders().num_columns:
        expected = f"synthesis.num_columns {load_encoders().num_columns}"
        raise ValueError(f"likeness.kind learned: expected {expected}, found {found}")


def likeness_of(params: FilterParams, camera: Spherical) -> Likeness:
    """Return the likeness of the parameters for a window of the sphere."""
    check_likeness(params)
    return Learned(camera) if params.likeness.kind == "learned" else Gradients(params.comparison)
