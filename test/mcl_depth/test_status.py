"""What one image makes of the belief, and what many make of the state."""

from __future__ import annotations

import numpy as np
import pytest

from localization.status import Reason, State
from mcl_depth.belief.hypotheses import Hypothesis
from mcl_depth.belief.motion_model import Step
from mcl_depth.params import StateParams
from mcl_depth.reasons import FINE, Finding
from mcl_depth.status import StateMachine, Verdict, judge, status_of

P = StateParams(probation_images=2, max_probation_images=5, lost_images=3, patience=4)
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
    assert (verdict.finding.reason, verdict.is_bad) == (reason, is_bad)


def states_of(machine, verdicts):
    found = []
    for verdict in verdicts:
        machine.take(verdict)
        found.append(machine.state)
    return found


def test_trust_needs_good_images_in_a_row():
    machine = StateMachine(P, is_automatic=True)
    found = states_of(machine, [BAD, Verdict(), BAD, Verdict(), Verdict()])
    assert found == [State.SEARCHING, State.PROBATION, State.SEARCHING, State.PROBATION, State.TRACKING]
    assert machine.is_trusted


def test_trust_is_lowered_by_care_and_lost_by_bad_images_in_a_row():
    machine = StateMachine(P, is_automatic=True)
    states_of(machine, [Verdict()] * 2)
    assert states_of(machine, [CAREFUL, Verdict(), Verdict()]) == [State.DEGRADED, State.DEGRADED, State.TRACKING]
    assert states_of(machine, [BAD] * 3) == [State.DEGRADED, State.DEGRADED, State.LOST]
    assert machine.num_losses == 1
    assert machine.needs_spreading


def test_each_loss_doubles_the_probation_up_to_a_bound():
    machine = StateMachine(P, is_automatic=True)
    found = [machine.probation_images]
    for _ in range(3):
        states_of(machine, [Verdict()] * 6)
        machine.lose()
        found.append(machine.probation_images)
    assert found == [2, 4, 5, 5]
    machine.reset()
    assert machine.probation_images == 2


def test_a_search_in_vain_begins_anew():
    machine = StateMachine(P, is_automatic=True)
    spread = []
    for _ in range(4):
        machine.take(BAD)
        spread.append(machine.needs_spreading)
    assert spread == [False, False, False, True]


def test_without_an_order_it_does_not_search():
    assert StateMachine(P, is_automatic=False).state is State.NOT_LOCALISED


def test_the_status_carries_the_finding():
    status = status_of(State.DEGRADED, 7, Finding(Reason.OUTLIERS, 0.5, 1.0), 0.8, 2.0)
    assert (status.state, status.reason, status.value, status.limit) == ("DEGRADED", "OUTLIERS", 0.5, 1.0)
    assert (status.stamp_ns, status.quality, status.age) == (7, 0.8, 2.0)
    assert status_of(State.TRACKING, 0, FINE, 1.0, 0.0).remedy == ""
