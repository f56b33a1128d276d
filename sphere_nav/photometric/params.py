"""What a registration goes by. Users set what `params.py` of each package makes of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache


@dataclass(frozen=True, kw_only=True)
class PyramidParams:
    """Coarse to fine."""

    num_levels: int = 5  # of the pyramid, the full image included
    min_side: int = 24  # px, smallest side of the coarsest level
    finest: int = 0  # level that is used; 0 is the full image
    coarsest: int = 9  # level that is used, where there are as many


@dataclass(frozen=True, kw_only=True)
class RegistrationParams:
    """ESM on image pyramids with Huber weights (M15 sections 2 and 9)."""

    pyramid: PyramidParams = field(default_factory=PyramidParams)
    max_pixels: int = 60_000  # best pixels used at a level, all references together
    max_iterations_coarse: int = 20  # iterations at the coarser levels
    max_iterations_fine: int = 8  # iterations at the finest level
    min_step: float = 0.02  # px, image motion of an increment below which a level is done
    far: float = 1e4  # m, range given to what is known to be far
    surface_ratio: float = 1.1  # ranges within this ratio in a 2 x 2 block are one surface
    min_overlap: float = 0.1  # share of the current image below which a result is refused
    min_pixels: int = 200  # visible pixels below which nothing is estimated
    max_condition: float = 1e9  # condition number of the scaled normal matrix above which texture is too low
    max_mad: float = 25.0  # grey level, median absolute deviation above which a result is refused
    correlated_pixels: float = 20.0  # pixels that count as one, where it cannot be measured


@cache
def between(
    params: RegistrationParams, *, finest: int | None = None, coarsest: int | None = None
) -> RegistrationParams:
    """Return the parameters of an alignment that uses only the levels between two; None: the one that is set."""
    pyramid = params.pyramid
    finest = pyramid.finest if finest is None else finest
    coarsest = max(finest, pyramid.coarsest if coarsest is None else coarsest)
    return replace(params, pyramid=replace(pyramid, finest=finest, coarsest=coarsest))
