"""When the pose is trusted: what the hypotheses say about one image, and what that makes of the state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from localization.state_machine import StateMachine
from localization.status import FINE, Finding, Reason, State
from mcl_depth.belief.hypotheses import Hypothesis
from mcl_depth.belief.motion_model import Step
from mcl_depth.params import StateParams


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


def count(states: StateMachine, verdict: Verdict, stamp_ns: int, params: StateParams) -> None:
    """Let the state follow from the verdict on one image; a place on probation that is refused was none."""
    if not verdict.is_bad:
        if not states.is_following:
            states.start()
        states.confirm(stamp_ns, is_good=verdict.finding is FINE)
        return
    if states.state in (State.PROBATION, State.LOST):
        states.search()
    states.refuse(is_lost=states.num_refused + 1 >= params.lost_images)


def is_in_vain(states: StateMachine, params: StateParams) -> bool:
    """Whether the search is to begin anew: just lost, or without success for too long."""
    return states.state is State.LOST or (not states.is_following and states.num_refused >= params.patience)
