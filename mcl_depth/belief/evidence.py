"""Is the place chance? The joint evidence of the last images for every cell and heading of the map.

A belief looks healthy in a map that it is not in: some place always fits best, and particles gather there. What tells
is how well the rest of the map fits the same images. So each image is compared with every cell
(`likeness/spectra.py`), and these fields are summed along odometry (`joint_evidence.py`).

The best place of the map is then held against the others: how far it exceeds what a drive elsewhere reaches says
whether the images are of this map, and by how much it leads its rival whether it is that place: `chances_of_place`.
Where only the first is sure, two places are alike. But streets of another town fit better than rooms of another home:
where the largest maxima of the map are but a `TAIL` of all that it has room for, they say as well what chance reaches
(`chance_of_lead`). A home is too small.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, uniform_filter

from mcl_depth.belief.estimate import Hypothesis
from mcl_depth.belief.image_motion import Reconciled
from mcl_depth.belief.joint_evidence import Field, JointEvidence, SurveyGrid
from mcl_depth.belief.motion_model import wrap_angle
from mcl_depth.belief.watch import PlaceTest, excess
from mcl_depth.constants import (
    APART,
    CHANCE_LEVEL,
    CHANCE_SHARE,
    EVEN_ODDS,
    LOCAL_M,
    MAX_HYPOTHESES,
    MAX_TRIAL,
    NEAR,
    NEW_SIGMA,
    NUM_MAXIMA,
    OFF_MAP,
    PEAK,
    RIVAL_SCALE,
    ROOM_M,
    TAIL,
    WIDE_M,
)
from mcl_depth.likeness.depth_map import Comparison
from sphere_nav.estimation.least_squares import gate
from sphere_nav.geometry.arrays import TINY, Array


@dataclass(frozen=True)
class Proof:
    """How often chance would look like a place: the best of the map, or one that is held or on trial.

    A held place was proven before, and is only to be kept. Where the map was searched, poses (K, 3) are its best
    places, best first, and shares (K,) of 1; `sigmas` (3,), m, m, rad, are how sharp they are.
    """

    p_chance: float
    is_held: bool = False
    poses: Array = field(default_factory=lambda: np.zeros((0, 3)))
    shares: Array = field(default_factory=lambda: np.zeros(0))
    sigmas: Array = field(default_factory=NEW_SIGMA.copy)
    is_in_map: bool = False  # one of the places is right, more surely than which
    is_proven: bool = False  # the first of them is more than chance

    @property
    def is_of_map(self) -> bool:
        """Whether the map was searched."""
        return len(self.poses) > 0

    def alike(self) -> Array:
        """Return the places (2, 3) that look alike, where it is known that one of them is right; else none (0, 3)."""
        return self.poses[: 2 if self.is_in_map else 0]

    def places(self, hypotheses: Sequence[Hypothesis]) -> tuple[Hypothesis, ...]:
        """Return the best places of the map where it was searched, each as sharp as the grid; else the hypotheses."""
        if not self.is_of_map:
            return tuple(hypotheses)
        best = zip(self.poses[:MAX_HYPOTHESES], self.shares, strict=False)
        return tuple(Hypothesis(pose, np.diag(self.sigmas**2), float(share)) for pose, share in best)

    def agrees_with(self, pose: Array) -> bool:
        """Whether a pose (3,) is the best place of the map, where that was searched."""
        if not self.is_of_map:
            return True
        off = pose - self.poses[0]
        off[2] = wrap_angle(off[2])
        return float(np.sum((off / self.sigmas) ** 2)) <= gate(3)


class Evidence:
    """Remembers the fields of the last images; sums them, and tests the best place of the map."""

    def __init__(self, grid: SurveyGrid, max_chance: float, chance_scale: float) -> None:
        """`max_chance`: a place that was accepted is chance so often; `chance_scale` is that of the likeness."""
        self._grid, self._max_chance, self._chance_scale = grid, max_chance, chance_scale
        self._drive = JointEvidence(grid.edge, grid.diagonal)
        self.reset()

    def reset(self, *, is_given: bool = False) -> None:
        """Forget all images. `is_given`: the place is known from outside, only to be confirmed."""
        self._drive.reset()
        self._watch = PlaceTest(self._max_chance, is_held=True)
        self._trial = PlaceTest(self._max_chance, is_held=False) if is_given else None
        self._num_left = MAX_TRIAL  # images until a trial that is still open ends
        self.place: Array | None = None  # (3,) to measure motion at while none is held: `prove`

    @property
    def is_on_trial(self) -> bool:
        """Whether a place that was given is neither confirmed nor refused."""
        return self._trial is not None

    def prove(self, comparison: Comparison, pose: Array, seen: Reconciled, *, is_held: bool) -> Proof:
        """Ask how often chance would look like a pose (3,): as the best of the map, or, once it is held, by itself.

        While none is held, `place` is the best of the map that is more than chance, or one that was given and is more
        probably right than wrong. Where nobody knows how the camera moved, a place is no more than one that was given.
        """
        if not seen.is_known:
            self.reset(is_given=True)
        self.place = None
        value = self._stands_out(comparison, pose) if is_held or self._trial is not None else None
        if is_held and seen.is_known:
            if value is not None:
                self._watch.add(value)
            return Proof(self._watch.p_chance, is_held=True)
        self._watch = PlaceTest(self._max_chance, is_held=True)
        if self._trial is not None and self._is_open(self._trial, value):
            self.place = pose if self._trial.p_chance < EVEN_ODDS else None
            return Proof(self._trial.p_chance)
        self._trial = None
        proof = self.survey(comparison, seen.observation.odometry)
        self.place = proof.poses[0] if proof.is_proven else None
        return proof

    def _is_open(self, trial: PlaceTest, value: float | None) -> bool:
        """Add an image to a trial; return whether the place is not refused.

        Particles seek what fits, so a wrong place that is given enough images finds some: a trial that stays open ends.
        """
        self._num_left -= 1
        trial.add(value or 0.0)  # where nobody can be an image fits as it does anywhere
        return trial.is_confirmed or (self._num_left > 0 and not trial.is_refused())

    def _stands_out(self, comparison: Comparison, pose: Array) -> float | None:
        """Return how far a pose (3,) stands out of what is around it in an image; None where it is off the map."""
        positions = self._grid.positions
        off = np.abs(positions - pose[:2]).max(axis=1)
        rows = np.flatnonzero(off <= 0.5 * LOCAL_M)
        is_near = off[rows] <= NEAR * self._grid.edge
        if not is_near.any():
            return None
        curves = _contrast(comparison.survey(positions[rows]))
        count = curves.shape[1]
        return excess(curves, is_near, round(float(pose[2]) / (2.0 * np.pi) * count) % count)

    def survey(self, comparison: Comparison, odometry: Array | None) -> Proof:
        """Add an image, taken at `odometry` (3,); without odometry it stands alone."""
        field = standardize(comparison.survey(self._grid.positions), self._grid)
        joint, num_images, extent_m = self._drive.add(field, odometry)
        places, values = find_maxima(joint, self._grid.mask)
        p_elsewhere, p_chance = chances_of_place(values, num_images, extent_m, self._chance_scale)
        room = len(joint) * len(self._grid.positions) / (2 * PEAK + 1) ** joint.ndim  # for so many maxima
        if TAIL * room >= NUM_MAXIMA:
            p_lead = chance_of_lead(values)
            p_elsewhere, p_chance = max(p_elsewhere, p_lead), max(p_chance, p_lead)
        shares = np.exp((values - values[0]) / RIVAL_SCALE)
        poses = self._grid.poses_of(places, len(joint))
        return Proof(
            p_chance,
            poses=poses,
            shares=shares / shares.sum(),
            sigmas=np.maximum(NEW_SIGMA, [0.5 * self._grid.edge, 0.5 * self._grid.edge, 0.0]),
            is_in_map=p_elsewhere < self._max_chance <= p_chance and len(poses) > 1,
            is_proven=p_chance < self._max_chance,
        )


def standardize(curves: NDArray[np.float32], grid: SurveyGrid) -> Field:
    """Return the field of one image from curves (K, A) of the grid's positions.

    By how many standard deviations a heading at a cell exceeds the mean of all headings there and of the same heading
    nearby; the best of neighbouring headings, since odometry and compass have steps.
    """
    num_headings = curves.shape[1]
    field = np.zeros((num_headings, *grid.shape), np.float32)
    field[:, grid.index[:, 0], grid.index[:, 1]] = _contrast(curves).T
    size = 2 * int(0.5 * LOCAL_M / grid.edge) + 1
    share = uniform_filter(grid.mask.astype(np.float32), size, mode="constant")
    local = uniform_filter(field, (1, size, size), mode="constant") / np.maximum(share, 1e-6)
    field = np.where(grid.mask, field - local, 0.0)
    field /= max(float(field[:, grid.mask].std()), 1e-9)
    field = np.maximum(field, np.maximum(np.roll(field, 1, axis=0), np.roll(field, -1, axis=0)))
    return np.where(grid.mask, field, OFF_MAP).astype(np.float32)


def find_maxima(joint: Field, mask: NDArray[np.bool_]) -> tuple[NDArray[np.int64], Array]:
    """Return the local maxima (N, 3) of a field by falling value, as heading, x, y, and their values (N,).

    Those around the first belong to it and are left out.
    """
    inside = np.where(mask, joint, -np.inf)
    highest = maximum_filter(inside, 2 * PEAK + 1, mode=("wrap", "constant", "constant"), cval=-np.inf)
    places = np.argwhere((inside == highest) & mask)
    values = joint[tuple(places.T)].astype(np.float64)
    order = np.argsort(-values, kind="stable")
    places, values = places[order], values[order]
    off = np.abs(places - places[0])
    off[:, 0] = np.minimum(off[:, 0], len(joint) - off[:, 0])
    is_kept = np.any(off > APART, axis=1)
    is_kept[0] = True
    return places[is_kept][: NUM_MAXIMA + 1], values[is_kept][: NUM_MAXIMA + 1]


def chances_of_place(values: Array, num_images: float, extent_m: float, scale: float) -> tuple[float, float]:
    """Return how probably a drive elsewhere reaches so much, and how probably it or a rival is taken for the place.

    `values` (N,) are the maxima of the map, falling, after so many images that are up to `extent_m` apart. Log odds are
    linear in all of them. A room elsewhere may fit image after image, so each gains `CHANCE_LEVEL`, 1 less for each
    metre that they are apart, beside a share of what the other places have; e times less often a `scale` beyond that.
    A rival leads the right place with exp(-(v_1 - v_2) / RIVAL_SCALE), more often within a room and its twin next door.
    Without a rival nothing is told: 1.
    """
    if len(values) < 2:
        return 1.0, 1.0
    reached = CHANCE_LEVEL * num_images - min(extent_m, WIDE_M) + CHANCE_SHARE * float(np.mean(values[1:]))
    p_elsewhere = float(np.exp(-max(values[0] - reached, 0.0) / scale))
    p_rival = float(np.exp(-min(extent_m / ROOM_M, 1.0) * (values[0] - values[1]) / RIVAL_SCALE))
    return p_elsewhere, max(p_elsewhere, p_rival)


def chance_of_lead(values: Array) -> float:
    """Return the probability that the first of falling values (N,) leads so far by chance.

    Were no place right, they would be the tail of one extreme-value distribution, which falls exponentially: the i-th
    gap times i is independent and of one exponential distribution (Renyi 1953). So the first by the mean of the n
    others is F(2, 2 n) distributed: p = (1 + first / sum of the others)^-n, whatever the scale of the tail.
    """
    gaps = np.arange(1, len(values)) * -np.diff(values)
    return float((1.0 + gaps[0] / max(float(gaps[1:].sum()), TINY)) ** (1 - len(gaps)))


def _contrast(curves: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return similarities (K, A) less the mean of their headings: some places fit any image better than others."""
    contrast: NDArray[np.float32] = curves - curves.mean(axis=1, keepdims=True)
    return contrast
