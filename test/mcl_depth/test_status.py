"""What one image makes of the belief, and what many make of the state."""

from __future__ import annotations

import numpy as np
import pytest

from localization.state_machine import StateMachine
from localization.status import Finding, Reason, State
from mcl_depth.belief.hypotheses import Hypothesis
from mcl_depth.belief.motion_model import Step
from mcl_depth.params import StateParams
from mcl_depth.reasons import REMEDIES
from mcl_depth.status import Verdict, count, is_in_vain, judge

P = StateParams(probation_images=2, lost_images=3, patience=4)
DRIVEN = Step(np.zeros(3), np.zeros(3))
CAREFUL, BAD = Verdict(Finding(Reason.ODOM_STALE)), Verdict(Finding(Reason.AMBIGUOUS), is_bad=True)


def place(weight=0.95, sigma_m=0.1, sigma_rad=0.02):
    covariance = np.diag([sigma_m**2, (0.5 * sigma_m) ** 2, sigma_rad**2])
    return Hypothesis(np.zeros(3), covariance, weight, np.arange(3))


@pytest.mark.parametrize(
    ("hypotheses", "lead", "step", "reason", "is_bad"),
    [
        ([place()], 3.0, DRIVEN, Reason.NONE, False),
        ([place(0.5), place(0.3)], 3.0, DRIVEN, Reason.AMBIGUOUS, True),
        ([place(0.7)], 3.0, DRIVEN, Reason.NO_CONVERGENCE, True),
        ([place(sigma_m=0.7)], 3.0, DRIVEN, Reason.NO_CONVERGENCE, True),
        ([place(sigma_rad=0.5)], 3.0, DRIVEN, Reason.NO_CONVERGENCE, True),
        ([place()], 0.5, DRIVEN, Reason.OUTLIERS, True),
        ([place()], 3.0, Step(np.zeros(3), np.zeros(3), jump=4.0), Reason.JUMP_REJECTED, False),
        ([place()], 3.0, Step(np.zeros(3), np.zeros(3), is_known=False), Reason.ODOM_STALE, False),
        ([place(sigma_m=0.5)], 3.0, DRIVEN, Reason.NO_CONVERGENCE, False),
    ],
)
def test_a_belief_is_judged(hypotheses, lead, step, reason, is_bad):
    verdict = judge(hypotheses, lead, step, P)
    assert verdict.finding.reason in REMEDIES
    assert (verdict.finding.reason, verdict.is_bad) == (reason, is_bad)


def searching() -> StateMachine:
    machine = StateMachine(P)
    machine.search()
    return machine


def states_of(machine, verdicts):
    found = []
    for number, verdict in enumerate(verdicts):
        count(machine, verdict, number * 10**8, P)
        found.append(machine.state)
    return found


def test_trust_needs_good_images_in_a_row():
    machine = searching()
    found = states_of(machine, [BAD, Verdict(), BAD, Verdict(), Verdict()])
    assert found == [State.SEARCHING, State.PROBATION, State.SEARCHING, State.PROBATION, State.TRACKING]
    assert (machine.is_trusted, machine.num_losses) == (True, 0)


def test_trust_is_lowered_by_care_and_lost_by_bad_images_in_a_row():
    machine = searching()
    states_of(machine, [Verdict()] * 2)
    assert states_of(machine, [CAREFUL, Verdict(), Verdict()]) == [State.DEGRADED, State.DEGRADED, State.TRACKING]
    assert states_of(machine, [BAD] * 3) == [State.DEGRADED, State.DEGRADED, State.LOST]
    assert machine.num_losses == 1
    assert is_in_vain(machine, P)


def test_a_search_in_vain_begins_anew():
    machine, found = searching(), []
    for _ in range(4):
        states_of(machine, [BAD])
        found.append(is_in_vain(machine, P))
    assert found == [False, False, False, True]
    machine.search()
    assert not is_in_vain(machine, P)
