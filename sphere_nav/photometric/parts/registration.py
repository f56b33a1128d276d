"""Images aligned by their parts, coarse to fine: where light has changed so much that grey levels say nothing.

Shadows, lamps, snow and cars that stand elsewhere change most of a view, and turn the contrast of some of it. Grey
levels then have no common minimum, but edges of what has stayed are where they were. At each level cells are matched
(`votes.py`) and the motion on which most agree is taken (`motion.py`); at the finest one the votes are the evidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.photometric.constants import (
    MIN_PART_SAMPLES,
    MIN_PARTS_SIDE,
    NUM_TRIED_MOTIONS,
    PART_ROUNDS,
    SURE_CHANCE,
)
from sphere_nav.photometric.params import RegistrationParams, between
from sphere_nav.photometric.parts.motion import fit_motion, motion_covariance
from sphere_nav.photometric.parts.votes import Votes, vote
from sphere_nav.photometric.pixels.samples import sample_images


@dataclass(frozen=True, eq=False)
class PartsAlignment:
    """T_world_body, its covariance (6, 6), and the chance of as many agreeing cells in a wrong place.

    All motions that were tried are counted in it.
    """

    T_world_body: SE3
    covariance: Array
    chance: float


def register_parts(images: Sequence[RigImage], T_world_body: SE3, params: RegistrationParams) -> PartsAlignment:
    """Align images of one body to their references from a first guess; `chance` says whether to believe it.

    It is begun at each level whose sides have `MIN_PARTS_SIDE` pixels, the coarsest first, which finds what is farthest
    off (`REACH` pixels of it), but has the fewest cells; the one that most speaks for counts.
    """
    levels = _usable_levels(images, params)
    best: PartsAlignment | None = None
    for number in range(len(levels), 0, -1):
        found = _descend(images, T_world_body, params, levels[:number], len(levels))
        best = found if best is None or found.chance < best.chance else best
        if best.chance <= SURE_CHANCE:
            break
    assert best is not None
    return best


def _descend(
    images: Sequence[RigImage], T_world_body: SE3, params: RegistrationParams, levels: Sequence[int], num_begun: int
) -> PartsAlignment:
    """Return the alignment through levels, the coarsest first; `num_begun` such are tried."""
    for level in reversed(levels):
        own = between(params, finest=level)
        for _ in range(PART_ROUNDS):
            xi = fit_motion(_vote(images, own, T_world_body).shifts)
            if xi is None:
                break
            T_world_body = T_world_body @ SE3.exp(xi)
    votes = _vote(images, params, T_world_body)
    covariance = motion_covariance(votes.shifts)
    chance = min(votes.chance * NUM_TRIED_MOTIONS * num_begun, 1.0)
    return PartsAlignment(T_world_body, covariance, chance)


def _usable_levels(images: Sequence[RigImage], params: RegistrationParams) -> list[int]:
    """Return the levels of which cells can be matched, the finest in any case."""
    finest, coarsest = params.pyramid.finest, min(len(image.pyramid.levels) for image in images) - 1
    cameras = [[image.pyramid.levels[level].camera for image in images] for level in range(coarsest + 1)]
    sides = [min(side for one in level for side in (one.width, one.height)) for level in cameras]
    wide = [level for level in range(finest, coarsest + 1) if sides[level] >= MIN_PARTS_SIDE]
    return wide or [min(finest, coarsest)]


def _vote(images: Sequence[RigImage], params: RegistrationParams, T_world_body: SE3) -> Votes:
    """Return how the cells of images agree at a pose; light is not asked."""
    light = np.tile([1.0, 0.0], (sum(len(image.views) for image in images), 1))
    return vote(images, params, sample_images(images, T_world_body, light, params).of_views(MIN_PART_SAMPLES))
