"""What the residuals say beyond the pose: do gradients agree, does an occlusion explain them, do parts of the view?

Grey levels of smooth surfaces correlate by chance wherever a fit may slide; their gradients do not. All checks use a
few thousand pixels, together or one after the other in different images. How far something has biased the pose: the
pixels are solved once more, without it (`PoseBias`).

Something before the camera that moves with it - a load, a hand, a bonnet, a queue - is no outlier to a robust weight
once it fills a third of the view: its edges hold the pose back while the vehicle goes on. The evidence: over a grid of
cells of the image, the mean cosine between the gradients of image and references. Cells that show the map agree, cells
that show something else do not, whatever pose has been found. Faint gradients, noise, edges seen from elsewhere and
another resolution make pixels of a cell scatter: it is occluded only where its mean is surely too low for that scatter.
The pose by the agreeing cells alone, found by a few steps, says how far the occluded ones bias it.

Where parked cars have gone and others stand, the gradients of a part of the view agree with nothing: the mean over the
view falls as it does in a wrong place, and what has changed pulls the pose. So where they agree little each part is
asked for itself (`parts/registration.py`). The pose by the agreeing cells alone, found by a few steps, is the one that
is judged (`Support`). Its covariance is that of how differently those cells pull, so that far ones that are all alike
do not pass for a view that holds the pose.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import Flag, auto

import numpy as np
from numpy.typing import NDArray

from sphere_nav.estimation.least_squares import clustered_covariance, gate, scaled_inverse, weigh, weighted_step
from sphere_nav.geometry import SE3, FrameMotion
from sphere_nav.geometry.arrays import TINY, Array
from sphere_nav.photometric.align.esm import UNKNOWN, Alignment
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.constants import (
    BIAS_STEPS,
    CELL_SIGMAS,
    CELLS,
    LAST_OCCLUSION_STEP_RAD,
    MAX_CHANCE,
    MAX_PREDICTED_CHANCE,
    MIN_CELL_PIXELS,
    MIN_COSINE_RATIO,
    MIN_SIGMA,
    MIN_VIEW_PIXELS,
    MIN_VISIBLE_SHARE,
    NUM_REWEIGHTINGS,
    NUM_TRIED_MOTIONS,
    OCCLUSION_SHARE,
    SURE_AGREEMENT,
    SURE_NCC,
)
from sphere_nav.photometric.params import RegistrationParams
from sphere_nav.photometric.parts.registration import Votes, fit_motion, motion_covariance, vote
from sphere_nav.photometric.pixels.samples import Sample, Sampler, cell_of, cosines, cosines_by_cell, sample_images

LeastSquares = tuple[Array, Array, NDArray[np.int64]]


@dataclass(frozen=True, eq=False)
class PoseBias:
    """share 0...1 of the evidence that the cause explains; xi (6,) from the pose to the one without it."""

    share: float = 0.0
    xi: Array = field(default_factory=lambda: np.zeros(6))

    @property
    def lengths(self) -> tuple[float, float]:
        """Size of the bias in m and in rad."""
        return float(np.linalg.norm(self.xi[:3])), float(np.linalg.norm(self.xi[3:]))


NO_BIAS = PoseBias()


def linearize_samples(sample: Sample) -> LeastSquares:
    """Return the derivative (N, 6 + 2 * views) of the residuals (N,), and the view (N,) of each.

    Columns of a view: gain, bias.
    """
    names, owner = np.unique(sample.view, return_inverse=True)
    J, rows, gain = np.zeros((len(owner), 6 + 2 * len(names))), np.arange(len(owner)), 6 + 2 * owner
    J[:, :6], J[rows, gain], J[rows, gain + 1] = sample.by_pose, sample.current, 1.0
    return J, sample.residual, owner


def solve_robustly(J: Array, residual: Array, owner: NDArray[np.int64]) -> tuple[Array, Array, Array]:
    """Return the step, the residuals (N,) after it, and their weights (N,)."""
    remaining = residual
    for _ in range(NUM_REWEIGHTINGS):
        weight = _weights(remaining, owner)
        x = weighted_step(J, residual, weight)
        remaining = residual + J @ x
    return x, remaining, weight


def _weights(residual: Array, owner: NDArray[np.int64]) -> Array:
    """Return Huber's weights (N,) by the scatter of each view."""
    weight = np.empty(len(residual))
    for index in np.unique(owner):
        own = owner == index
        weight[own], _ = weigh(residual[own], MIN_SIGMA)
    return weight


def find_occlusion_bias(sampler: Sampler, sample: Sample, T_world_body: SE3) -> PoseBias:
    """Return the bias at an aligned pose; where a part is occluded, sample pixels anew on the way to the one without.

    The share is that of the texture, of the references or of the image, in cells that do not agree: a pale wall has
    none to lose. Gradients are those of the reference: of the image the gain is biased, too.
    """
    share, kept = keep_agreeing(sample)
    T_bias = SE3.identity()
    for _ in range(BIAS_STEPS if share >= OCCLUSION_SHARE else 0):
        if len(kept) <= MIN_VISIBLE_SHARE * len(sample):
            break
        step = solve_robustly(*linearize_samples(replace(kept, of_image=kept.of_reference)))[0][:6]
        T_bias = T_bias @ SE3.exp(step)
        if _motion(kept, step) < LAST_OCCLUSION_STEP_RAD:
            break
        sample = sampler(T_world_body @ T_bias)
        _, kept = keep_agreeing(sample)
    return PoseBias(share, T_bias.log())


def keep_agreeing(sample: Sample) -> tuple[float, Sample]:
    """Return the share 0..1 of the texture in cells that do not agree, and the pixels of the others."""
    part = sample.where(_cells_that_agree(sample)[cell_of(sample, CELLS)])
    share = np.max(1.0 - _strength(part) / np.maximum(_strength(sample), TINY))
    return float(share), part.of_views(MIN_VIEW_PIXELS)


def _strength(sample: Sample) -> Array:
    """Return the sums of squared gradients by the angle, (2,): of the reference, of the image."""
    gradients = sample.of_reference, sample.of_image
    return np.array([float(sample.range_m**2 @ np.einsum("ni,ni->n", rows, rows)) for rows in gradients])


def _cells_that_agree(sample: Sample) -> NDArray[np.bool_]:
    """Return for each cell whether it shows what the references do; true where that is not sure."""
    found = cosines_by_cell(sample, CELLS, MIN_CELL_PIXELS)
    scatter = (found.weight * (found.cosine - found.mean[found.cell])) ** 2
    variance = np.bincount(found.cell, scatter, len(found.total)) / np.maximum(found.total, TINY) ** 2
    return ~found.known | (found.mean + CELL_SIGMAS * np.sqrt(variance) >= MIN_COSINE_RATIO * found.typical)


def _motion(sample: Sample, step: Array) -> float:
    """Return the median angle by which a step moves points, seen from the body."""
    motion = step[:3] + np.cross(step[3:], sample.points)
    return float(np.median(np.linalg.norm(motion, axis=1) / np.linalg.norm(sample.points, axis=1)))


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


class Aspect(Flag):
    """What may be checked of residuals: gradients, an occlusion, how likely the place is."""

    FIT = auto()
    OCCLUSION = auto()
    PLACE = auto()


NOTHING = Aspect(0)
EVERYTHING = Aspect.FIT | Aspect.OCCLUSION


@dataclass(frozen=True)
class Structure:
    """What the residuals of an alignment look like; what was not checked is as if nothing were wrong.

    agreement is the mean cosine -1...1 between the gradients of image and references. occlusion is the bias of the pose
    by what hides a part of the view. support is what its parts say where the mean agreement is low; where it is proven,
    the pose without the other parts is in it, and no occlusion is looked for. chance is how probably as many parts
    agree in a wrong place.
    """

    agreement: float = 1.0
    occlusion: PoseBias = NO_BIAS
    support: Support = NO_SUPPORT
    chance: float = 1.0


def find_rig_structure(
    images: Sequence[RigImage],
    alignment: Alignment,
    params: RegistrationParams,
    motion: FrameMotion | None = None,
    aspects: Aspect = EVERYTHING,
    T_predicted: SE3 | None = None,
) -> Structure:
    """Check an alignment of `register_rig`: the mean agreement, what biases the pose.

    Of too few pixels it says nothing. A pose that was predicted is one more that parts of the view may support.
    """

    def sample_at(T_world_body: SE3) -> Sample:
        return sample_images(images, T_world_body, alignment.light, params, motion).of_views(MIN_VIEW_PIXELS)

    def vote_at(T_world_body: SE3) -> Votes:
        return vote(images, params, sample_at(T_world_body))

    pose = alignment.T_world_camera
    sample, is_asked = sample_at(pose), Aspect.FIT in aspects
    found = Structure(_agreement(sample)) if is_asked else Structure()
    if is_asked and (found.agreement < SURE_AGREEMENT or alignment.ncc < SURE_NCC):
        support = find_support(vote_at, pose, T_predicted)
        found = replace(found, support=support, chance=support.chance)
    elif Aspect.PLACE in aspects:
        found = replace(found, chance=vote(images, params, sample).chance)
    if found.support.is_proven or Aspect.OCCLUSION not in aspects:
        return found
    return replace(found, occlusion=find_occlusion_bias(sample_at, sample, pose))


def _agreement(sample: Sample) -> float:
    """Return the mean cosine between the gradients, each pixel by how strong it is in the reference."""
    cosine, weight = cosines(sample)
    return float(weight @ cosine) / max(float(weight.sum()), TINY)
