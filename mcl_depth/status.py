"""When the pose is trusted: what the hypotheses say about one image, and the state machine of FIELD 6.4 over many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from localization.status import FOLLOWING, TRUSTED, Reason, State, Status
from mcl_depth.belief.hypotheses import Hypothesis
from mcl_depth.belief.motion_model import Step
from mcl_depth.params import StateParams
from mcl_depth.reasons import FINE, Finding


@dataclass(frozen=True)
class Verdict:
    """What one image makes of the belief: nothing to say, a finding to be careful with, or a bad one."""

    finding: Finding = FINE
    is_bad: bool = False


def judge(hypotheses: Sequence[Hypothesis], lead: float, step: Step, params: StateParams) -> Verdict:
    """Judge the belief after an image; `lead` is how far its place stands out, in standard deviations of the map.

    Where particles do not agree and odometry failed, odometry is the reason that is given.
    """
    verdict = _judge_belief(hypotheses, lead, params)
    if verdict.finding.reason not in (Reason.NONE, Reason.NO_CONVERGENCE):
        return verdict
    if step.jump > 0.0:
        return Verdict(Finding(Reason.JUMP_REJECTED, step.jump, 0.0), verdict.is_bad)
    return verdict if step.is_known else Verdict(Finding(Reason.ODOM_STALE), verdict.is_bad)


def _judge_belief(hypotheses: Sequence[Hypothesis], lead: float, params: StateParams) -> Verdict:
    best = hypotheses[0]
    second = hypotheses[1].weight if len(hypotheses) > 1 else 0.0
    limit_rad = np.radians(params.max_sigma_deg)
    if second >= params.ambiguous_share * best.weight:
        return Verdict(Finding(Reason.AMBIGUOUS, second / best.weight, params.ambiguous_share), is_bad=True)
    if best.weight < params.min_weight:
        return Verdict(Finding(Reason.NO_CONVERGENCE, best.weight, params.min_weight, "belief in one place"), True)
    if best.sigma_m > params.max_sigma_m:
        return Verdict(Finding(Reason.NO_CONVERGENCE, best.sigma_m, params.max_sigma_m, "spread in m"), True)
    if best.sigma_rad > limit_rad:
        return Verdict(Finding(Reason.NO_CONVERGENCE, best.sigma_rad, float(limit_rad), "spread in rad"), True)
    if lead < params.min_lead:
        return Verdict(Finding(Reason.OUTLIERS, lead, params.min_lead, "lead over the rest of the map"), True)
    if best.sigma_m > params.good_sigma_m:
        return Verdict(Finding(Reason.NO_CONVERGENCE, best.sigma_m, params.good_sigma_m, "spread in m"))
    return Verdict()


class StateMachine:
    """Counts good and bad images; knows nothing of particles."""

    def __init__(self, params: StateParams, *, is_automatic: bool) -> None:
        self._params, self._first = params, State.SEARCHING if is_automatic else State.NOT_LOCALISED
        self._num_good = self._num_bad = 0
        self.reset()

    @property
    def is_trusted(self) -> bool:
        """Whether the pose may be published."""
        return self.state in TRUSTED

    @property
    def is_following(self) -> bool:
        """Whether one place is held to be the right one."""
        return self.state in FOLLOWING

    @property
    def needs_spreading(self) -> bool:
        """Whether the search is to begin anew: just lost, or in vain for too long."""
        return self.state is State.LOST or (self.state is State.SEARCHING and self._num_bad >= self._params.patience)

    @property
    def probation_images(self) -> int:
        """Good images in a row that end the probation; doubled by each loss up to a bound."""
        p = self._params
        return min(p.probation_images * 2 ** min(self.num_losses, 16), max(p.max_probation_images, p.probation_images))

    def reset(self) -> None:
        """Begin anew: nothing is known, earlier losses are forgotten."""
        self.num_losses = 0
        self._enter(self._first)

    def search(self) -> None:
        """Say that the pose is being looked for."""
        self._enter(State.SEARCHING)

    def lose(self) -> None:
        """Give the pose up, if there was one."""
        if self.is_following:
            self.num_losses += 1
            self._enter(State.LOST)

    def take(self, verdict: Verdict) -> None:
        """Count one image."""
        if verdict.is_bad:
            self._take_bad()
            return
        self._num_bad = 0
        self._num_good = self._num_good + 1 if verdict.finding is FINE else 0
        if self.state in (State.SEARCHING, State.LOST):
            self._enter(State.PROBATION, num_good=self._num_good)
        if self.state is State.PROBATION and self._num_good >= self.probation_images:
            self._enter(State.TRACKING)
        elif self.state is State.TRACKING and verdict.finding is not FINE:
            self._enter(State.DEGRADED)
        elif self.state is State.DEGRADED and self._num_good >= 2:
            self._enter(State.TRACKING)

    def _take_bad(self) -> None:
        self._num_good, self._num_bad = 0, self._num_bad + 1
        if self.state in (State.PROBATION, State.LOST):
            self._enter(State.SEARCHING, num_bad=1)
        elif self.state is State.TRACKING:
            self._enter(State.DEGRADED, num_bad=1)
        elif self.state is State.DEGRADED and self._num_bad >= self._params.lost_images:
            self.lose()

    def _enter(self, state: State, num_good: int = 0, num_bad: int = 0) -> None:
        self.state, self._num_good, self._num_bad = state, num_good, num_bad


def status_of(state: State, stamp_ns: int, finding: Finding, quality: float, age: float) -> Status:
    """Return the status of a state with its finding; `quality` is the share of the belief."""
    words = str(finding.reason), finding.value, finding.limit, finding.remedy
    return Status(state, *words, quality=quality, age=age, stamp_ns=stamp_ns)
