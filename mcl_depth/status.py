"""When the pose is trusted: what the hypotheses say about one image, and what that makes of the state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mcl_depth.belief.estimate import Hypothesis
from mcl_depth.belief.evidence import Proof
from mcl_depth.belief.image_motion import Reconciled
from mcl_depth.belief.motion_model import Step
from mcl_depth.constants import EVEN_ODDS, LOST_IMAGES, MAX_SIGMA_M, MAX_SIGMA_RAD, MIN_WEIGHT
from sphere_nav.localization.constants import PROVEN_IMAGES
from sphere_nav.localization.status import FINE, INPUT_REMEDIES, Reason, State, StateMachine, Verdict

REMEDIES = INPUT_REMEDIES | {
    Reason.LOW_OVERLAP: "the image shows too little of a panorama: set likeness.kind to gradients",
    Reason.OUTLIERS: "no place is proven: drive on, or give an initial pose; check cloud and camera height",
    Reason.NO_CONVERGENCE: "the particles do not agree on one place yet: drive on",
    Reason.JUMP_REJECTED: "odometry leapt and was not believed: check the wheels and who resets odometry",
    Reason.AMBIGUOUS: "two places look alike: drive on until they differ, or give an initial pose",
    Reason.MAP_ERROR: "nothing can be localised so: correct what is named; of a cloud, its unit and its extent",
    Reason.ODOM_STALE: "odometry is missing, so no new place is trusted: check the topic odom and its stamps",
}


@dataclass(frozen=True)
class BeliefVerdict:
    """What one image makes of the belief: nothing to say, a finding to be careful with, or a bad one."""

    finding: Verdict = FINE
    is_bad: bool = False
    is_lost: bool = False  # nobody knows where the vehicle is
    num_images: int = 1  # that it counts for on probation

    def beside(self, seen: Reconciled) -> BeliefVerdict:
        """Return the verdict beside what images have against odometry."""
        if not seen.is_known:
            return BeliefVerdict(seen.finding, is_bad=True, is_lost=True)
        if self.is_bad:
            return self if seen.hint is FINE else BeliefVerdict(seen.hint, is_bad=True)
        return self if seen.finding is FINE else BeliefVerdict(seen.finding)


def judge_belief(best: Hypothesis, proof: Proof, step: Step, max_chance: float) -> BeliefVerdict:
    """Judge the belief after an image, by its likeliest place.

    Where particles do not agree, or the place is not proven, and odometry failed, odometry is the reason that is given.
    """
    verdict = _judge_belief(best, proof, max_chance)
    is_unproven = verdict.finding.reason == Reason.OUTLIERS and not proof.is_held
    if not is_unproven and verdict.finding.reason not in (Reason.NONE, Reason.NO_CONVERGENCE):
        return verdict
    if step.jump > 0.0:
        return BeliefVerdict(Verdict(Reason.JUMP_REJECTED, step.jump, 0.0), verdict.is_bad)
    return verdict if step.is_known else BeliefVerdict(Verdict(Reason.ODOM_STALE), verdict.is_bad)


def _judge_belief(best: Hypothesis, proof: Proof, max_chance: float) -> BeliefVerdict:
    limit = EVEN_ODDS if proof.is_held else max_chance
    alike = " or ".join(f"{x:.1f}, {y:.1f} at {np.degrees(yaw):.0f} deg" for x, y, yaw in proof.alike())
    another, chance = "another place fits the last images better", "probability that the place is chance"
    spread = Reason.NO_CONVERGENCE
    faults = {
        Verdict(Reason.AMBIGUOUS, proof.p_chance, limit, alike): proof.is_in_map,
        Verdict(spread, best.weight, MIN_WEIGHT, "belief in one place"): best.weight < MIN_WEIGHT,
        Verdict(spread, best.sigma_m, MAX_SIGMA_M, "spread in m"): best.sigma_m > MAX_SIGMA_M,
        Verdict(spread, best.sigma_rad, MAX_SIGMA_RAD, "spread in rad"): best.sigma_rad > MAX_SIGMA_RAD,
        Verdict(Reason.AMBIGUOUS, proof.p_chance, limit, another): not proof.agrees_with(best.pose),
        Verdict(Reason.OUTLIERS, proof.p_chance, limit, chance): proof.p_chance >= limit,
    }
    if any(faults.values()):
        return BeliefVerdict(next(fault for fault, is_so in faults.items() if is_so), is_bad=True)
    return BeliefVerdict(num_images=PROVEN_IMAGES if proof.is_of_map else 1)


def count(states: StateMachine, verdict: BeliefVerdict, stamp_ns: int) -> None:
    """Let the state follow from the verdict on one image; a place on probation that is refused was none."""
    if not verdict.is_bad:
        if not states.is_following:
            states.start()
        states.confirm(stamp_ns, is_good=verdict.finding is FINE, num_images=verdict.num_images)
        return
    if verdict.is_lost or states.state in (State.PROBATION, State.LOST):
        states.search()
    states.refuse(is_lost=states.num_refused + 1 >= LOST_IMAGES)
