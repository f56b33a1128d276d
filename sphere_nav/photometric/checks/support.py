"""Do enough parts of the view show the map where an alignment says it is?

Where parked cars have gone and others stand, the gradients of a part of the view agree with nothing: the mean over the
view falls as it does in a wrong place, and what has changed pulls the pose. So each part is asked for itself
(`parts/votes.py`). The pose by the agreeing cells alone, found by a few steps, is the one that is judged. Its
covariance is that of how differently those cells pull, so that far ones that are all alike do not pass for a view that
holds the pose.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from sphere_nav.estimation.covariance import clustered_covariance
from sphere_nav.estimation.gates import gate
from sphere_nav.estimation.normal_equations import scaled_inverse
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.photometric.align.judgement import UNKNOWN
from sphere_nav.photometric.checks.bias import linearize_samples, solve_robustly
from sphere_nav.photometric.constants import (
    BIAS_STEPS,
    MAX_CHANCE,
    MAX_PREDICTED_CHANCE,
    NUM_TRIED_MOTIONS,
)
from sphere_nav.photometric.parts.motion import fit_motion, motion_covariance
from sphere_nav.photometric.parts.votes import Votes

Voter = Callable[[SE3], Votes]  # asks the cells at a T_world_body


@dataclass(frozen=True, eq=False)
class Support:
    """How many cells there are and agree, the chance of as many, and xi (6,) from the aligned pose to theirs.

    covariance (6, 6) is that of their pose, by how differently they pull it.
    """

    num_cells: int = 0
    num_agreeing: int = 0
    chance: float = 1.0
    xi: Array = field(default_factory=lambda: np.zeros(6))
    covariance: Array = field(default_factory=UNKNOWN.copy)

    @property
    def is_proven(self) -> bool:
        """Whether more cells agree than in a wrong place."""
        return self.chance <= MAX_CHANCE


NO_SUPPORT = Support()


def find_support(vote: Voter, T_world_body: SE3, T_predicted: SE3 | None = None) -> Support:
    """Return the support of an aligned pose; where it is not proven, that of a predicted one, which may be.

    What has changed can draw the alignment away from a prediction that was good, at coarse levels most of all: the
    prediction is asked as it is, and moved as most cells are shifted. It needs a smaller chance, as the alignment
    speaks against it. Either way the pose is the one that the agreeing cells find from there.
    """
    aligned = _follow(vote, T_world_body)
    if aligned.is_proven or T_predicted is None:
        return aligned
    for start, num_tries in _predictions(vote, T_predicted):
        found = _follow(vote, start)
        if found.chance * num_tries <= MAX_PREDICTED_CHANCE:
            return replace(found, xi=(T_world_body.inverse() @ start @ SE3.exp(found.xi)).log())
    return aligned


def _predictions(vote: Voter, T_predicted: SE3) -> Iterator[tuple[SE3, int]]:
    """Yield poses from a prediction: as it is, as most cells are shifted.

    With each, how many motions were tried to find it.
    """
    yield T_predicted, 1
    xi = fit_motion(vote(T_predicted).shifts)
    if xi is not None:
        yield T_predicted @ SE3.exp(xi), NUM_TRIED_MOTIONS


def _follow(vote: Voter, T_world_body: SE3) -> Support:
    """Return the support of the pose that the agreeing cells find; pixels are sampled anew after each step."""
    T_step, votes, covariance = SE3.identity(), vote(T_world_body), NO_SUPPORT.covariance
    for _ in range(BIAS_STEPS):
        if votes.chance > MAX_CHANCE:
            break
        J, residual, owner = linearize_samples(votes.kept)
        step, remaining, weight = solve_robustly(J, residual, owner)
        inverse, gradients = scaled_inverse((weight[:, None] * J).T @ J), (weight * remaining)[:, None] * J
        covariance = clustered_covariance(inverse, gradients, votes.owner, J.shape[1])[:6, :6]
        if step[:6] @ scaled_inverse(covariance) @ step[:6] < gate(6, 0.05):  # it says nothing
            break
        T_step = T_step @ SE3.exp(step[:6])
        votes = vote(T_world_body @ T_step)
    if votes.chance <= MAX_CHANCE:  # few cells hold a pose no better than they are matched, however alike they pull
        covariance = covariance + motion_covariance(votes.shifts)
    cells = int(votes.is_known.sum()), int(votes.agrees.sum())
    return Support(*cells, votes.chance, T_step.log(), covariance)
