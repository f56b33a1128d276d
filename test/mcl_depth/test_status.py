"""What one image makes of the belief, and what many make of the state."""

from __future__ import annotations

import numpy as np
import pytest

from mcl_depth.belief.estimate import Hypothesis
from mcl_depth.belief.evidence import Proof
from mcl_depth.belief.motion_model import Step
from mcl_depth.params import MclStateParams
from mcl_depth.status import REMEDIES, BeliefVerdict, count, judge_belief
from sphere_nav.localization.status import Reason, State, StateMachine, Verdict

LOST_IMAGES = 6

P = MclStateParams(probation_images=2)
SURE, CHANCE, ELSEWHERE = Proof(1e-5), Proof(0.2), Proof(1e-5, poses=np.array([[9.0, 9.0, 0.0]]))
HELD = Proof(1e-2, is_held=True)
DRIVEN = Step(np.zeros(3), np.zeros(3))
CAREFUL, BAD = BeliefVerdict(Verdict(Reason.ODOM_STALE)), BeliefVerdict(Verdict(Reason.AMBIGUOUS), is_bad=True)


def place(weight=0.95, sigma_m=0.1, sigma_rad=0.02):
    covariance = np.diag([sigma_m**2, (0.5 * sigma_m) ** 2, sigma_rad**2])
    return Hypothesis(np.zeros(3), covariance, weight)


def judge(best, proof, step):
    """As in a home: cells have edges of 0.354 m."""
    return judge_belief(best, proof, step, max_chance=1e-3)


def test_a_belief_is_judged():
    for best, proof, step, reason, is_bad in [
        (place(0.5), SURE, DRIVEN, Reason.NO_CONVERGENCE, True),
        (place(), CHANCE, DRIVEN, Reason.OUTLIERS, True),
        (place(), HELD, DRIVEN, Reason.NONE, False),
        (place(), ELSEWHERE, DRIVEN, Reason.AMBIGUOUS, True),
        (place(), SURE, Step(np.zeros(3), np.zeros(3), jump=4.0), Reason.JUMP_REJECTED, False),
        (place(), SURE, Step(np.zeros(3), np.zeros(3), is_known=False), Reason.ODOM_STALE, False),
        (place(), Proof(0.6, is_held=True), Step(np.zeros(3), np.zeros(3), jump=4.0), Reason.OUTLIERS, True),
    ]:
        verdict = judge(best, proof, step)
        assert verdict.finding.reason in REMEDIES
        assert (verdict.finding.reason, verdict.is_bad) == (reason, is_bad)


def test_two_places_that_are_alike_are_named():
    poses = np.array([[1.0, 2.0, 0.0], [4.0, -2.0, np.pi / 2], [9.0, 9.0, 0.0]])
    proof = Proof(0.3, poses=poses, shares=np.array([0.5, 0.4, 0.1]), is_in_map=True)
    finding = judge(place(), proof, DRIVEN).finding
    assert finding.reason == Reason.AMBIGUOUS
    assert finding.remedy(REMEDIES).startswith("1.0, 2.0 at 0 deg or 4.0, -2.0 at 90 deg; two places look alike")


@pytest.mark.parametrize(("count", "num_images"), [(1, 2), (0, 1)])
def test_an_image_counts_for_two_where_the_map_was_searched(count, num_images):
    proof = Proof(0.9e-3, poses=np.zeros((count, 3)))
    assert judge(place(), proof, DRIVEN).num_images == num_images


def searching() -> StateMachine:
    machine = StateMachine(P)
    machine.search()
    return machine


def states_of(machine, verdicts):
    found = []
    for number, verdict in enumerate(verdicts):
        count(machine, verdict, number * 10**8)
        found.append(machine.state)
    return found


def test_trust_needs_good_images_in_a_row():
    machine = searching()
    found = states_of(machine, [BAD, BeliefVerdict(), BAD, BeliefVerdict(), BeliefVerdict()])
    assert found == [State.SEARCHING, State.PROBATION, State.SEARCHING, State.PROBATION, State.TRACKING]
    assert (machine.is_trusted, machine.num_losses) == (True, 0)


def test_trust_is_lowered_by_care_and_lost_by_bad_images_in_a_row():
    machine = searching()
    states_of(machine, [BeliefVerdict()] * 2)
    assert states_of(machine, [CAREFUL, BeliefVerdict(), BeliefVerdict()]) == [
        State.DEGRADED,
        State.DEGRADED,
        State.TRACKING,
    ]
    assert states_of(machine, [BAD] * LOST_IMAGES) == [State.DEGRADED] * (LOST_IMAGES - 1) + [State.LOST]
    assert machine.num_losses == 1


def test_each_limit_has_two_sides():
    for best, proof, reason, is_bad in [
        (place(0.799), SURE, Reason.NO_CONVERGENCE, True),
        (place(0.801), SURE, Reason.NONE, False),
        (place(sigma_m=0.61), SURE, Reason.NO_CONVERGENCE, True),
        (place(sigma_m=0.59), SURE, Reason.NONE, False),
        (place(sigma_rad=np.radians(15.1)), SURE, Reason.NO_CONVERGENCE, True),
        (place(sigma_rad=np.radians(14.9)), SURE, Reason.NONE, False),
        (place(), Proof(1.01e-3), Reason.OUTLIERS, True),
        (place(), Proof(1e-3), Reason.OUTLIERS, True),
        (place(), Proof(0.99e-3), Reason.NONE, False),
        (place(), Proof(0.5, is_held=True), Reason.OUTLIERS, True),
        (place(), Proof(0.49, is_held=True), Reason.NONE, False),
    ]:
        verdict = judge(best, proof, DRIVEN)
        assert (verdict.finding.reason, verdict.is_bad) == (reason, is_bad)
