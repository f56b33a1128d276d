"""Parameters of direct registration."""

from __future__ import annotations

from sphere_nav.estimation.robust import HUBER
from sphere_nav.params import group, param, parameters


@parameters
class PyramidParams:
    """Coarse to fine."""

    num_levels: int = param(5, "levels of the pyramid, the full image included", low=1, high=10)
    min_side: int = param(24, "smallest side of the coarsest level", "px", low=8)
    finest: int = param(0, "finest level that is used; 0 is the full image", low=0, high=9)
    coarsest: int = param(9, "coarsest level that is used, where there are as many", low=0, high=9)


@parameters
class RegistrationParams:
    """ESM on image pyramids with Huber weights (M15 sections 2 and 9)."""

    pyramid: PyramidParams = group(PyramidParams)
    max_pixels: int = param(60_000, "best pixels used at a level, all references together", low=100)
    huber: float = param(HUBER, "residual, in standard deviations, beyond which weights fall (eq. 34)", low=0.1)
    min_sigma: float = param(1.0, "smallest standard deviation assumed for the residual", "grey level", low=0.01)
    max_iterations_coarse: int = param(20, "iterations at the coarser levels", low=0, high=200)
    max_iterations_fine: int = param(8, "iterations at the finest level", low=0, high=200)
    min_step: float = param(0.02, "image motion of an increment below which a level is done", "px", low=1e-6)
    illumination: bool = param(True, "estimate a gain and a bias for each reference with the pose")
    far: float = param(1e4, "range given to what is known to be far", "m", low=10.0)
    surface_ratio: float = param(1.1, "ranges within this ratio in a 2 x 2 block are one surface", low=1.0)
    min_overlap: float = param(0.1, "share of the current image below which a result is refused", low=0.0, high=1.0)
    min_pixels: int = param(200, "visible pixels below which nothing is estimated", low=20)
    max_condition: float = param(1e9, "condition number of the scaled normal matrix above which texture is too low")
    max_mad: float = param(25.0, "median absolute deviation above which a result is refused", "grey level", low=0.0)
    correlated_pixels: float = param(20.0, "pixels that count as one, where it cannot be measured", low=1.0)
