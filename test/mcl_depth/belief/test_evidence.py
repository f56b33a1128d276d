"""The test for chance: exact where nothing is there to be found, sharp where the true place is among the rest."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from mcl_depth.belief.estimate import Observation
from mcl_depth.belief.evidence import Evidence, Proof, chance_of_lead, chances_of_place
from mcl_depth.belief.image_motion import Reconciled
from mcl_depth.belief.joint_evidence import EvidenceLevel, JointEvidence, SurveyGrid
from mcl_depth.belief.motion_model import compose_planar, relative_motion
from sphere_nav.geometry import Spherical
from sphere_nav.localization.status import FINE, Reason, Verdict

COST = np.float32(2.5)
FORGETTING = np.float32(0.97)
MAX_TRIAL = 12
RIVAL_SCALE = 0.6

SLIP = Verdict(Reason.JUMP_REJECTED)
EDGE, SIDE, NUM_HEADINGS, RATE, SIGMA = 0.5, 40, 36, 1e-3, 0.9


def seen(odometry=None, finding=FINE, **flags):
    """An image with its odometry, and what it has against it; of what it shows only `Images` tells."""
    image = Observation(np.zeros((8, 16), np.uint8), Spherical(16, 8), 1, np.eye(3), odometry)
    return Reconciled(image, finding, **flags)


def grid_of(side=SIDE):
    axis = (np.arange(side) + 0.5) * EDGE
    middles = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    cells = SimpleNamespace(
        edge=EDGE, cache=SimpleNamespace(capacity=10**6), cells=lambda xy: np.floor(xy / EDGE).astype(np.int64)
    )
    return SurveyGrid(cells, middles)


class Images:
    """Noise that fits every place by chance, and one place by `signal` standard deviations more."""

    def __init__(self, grid, seed, pose=None, signal=0.0):
        self._positions = grid.positions
        self._curves = np.random.default_rng(seed).normal(1.3, 0.02, (len(grid.positions), NUM_HEADINGS))
        if pose is not None:
            nearest = np.argmin(np.linalg.norm(grid.positions - pose[:2], axis=1))
            heading = round(pose[2] / (2 * np.pi) * NUM_HEADINGS) % NUM_HEADINGS
            self._curves[nearest, heading] += 0.02 * signal

    def survey(self, positions):
        return self._curves[cKDTree(self._positions).query(positions)[1]].astype(np.float32)


def test_the_lead_of_an_exponential_tail_has_a_uniform_p():
    rng = np.random.default_rng(4)
    found = np.array([chance_of_lead(np.sort(rng.exponential(3.0, 40))[::-1]) for _ in range(4000)])
    for level in (0.5, 0.1, 0.01):
        share = np.mean(found < level)
        assert share == pytest.approx(level, abs=4 * np.sqrt(level / 4000))  # four standard errors


def test_a_place_leads_both_its_rivals_and_drives_that_are_not_there():
    sure = EvidenceLevel(turned=3.0, num_images=9.0, extent_m=99.0)
    p_elsewhere, p_chance = chances_of_place(np.array([18.0, 9.0]), sure, SIGMA)
    assert p_elsewhere < RATE
    assert p_chance == p_elsewhere  # the rival is further behind
    by_rival = pytest.approx(np.exp(-3.0 / RIVAL_SCALE))
    assert chances_of_place(np.array([18.0, 15.0]), sure, SIGMA) == (p_elsewhere, by_rival)
    # what many images add up to says less
    later = EvidenceLevel(turned=3.0, num_images=16.0, extent_m=12.0)
    assert chances_of_place(np.array([18.0, 9.0]), later, SIGMA)[0] > 10.0 * p_elsewhere
    assert chances_of_place(np.array([5.5, 1.0]), sure, SIGMA) == (1.0, 1.0)
    rooms = chances_of_place(np.array([18.0, 15.0]), replace(sure, extent_m=6.0), SIGMA)
    assert rooms == pytest.approx((p_elsewhere**0.5, np.exp(-2.25 / RIVAL_SCALE)))  # images of one room err together
    assert chances_of_place(np.array([20.0]), sure, SIGMA) == (1.0, 1.0)  # no rival
    wide, narrow = (chances_of_place(np.array([18.0, 9.0]), sure, sigma)[0] for sigma in (2 * SIGMA, SIGMA))
    assert wide == pytest.approx(narrow**0.25)


def drive(count):
    """Poses on a bend and odometry of them from another origin."""
    poses = [np.array([6.0, 5.0, 0.4])]
    for _ in range(count - 1):
        poses.append(compose_planar(poses[-1][None], np.array([1.0, 0.0, 0.08]))[0])
    origin = np.array([30.0, -4.0, -2.0])
    return poses, [compose_planar(origin[None], relative_motion(poses[0], pose))[0] for pose in poses]


def test_images_of_another_place_are_chance():
    grid = grid_of()
    _, odometry = drive(6)
    found = []
    for trial in range(4):
        evidence = Evidence(grid, RATE, SIGMA)
        for number, before in enumerate(odometry):
            survey = evidence.survey(Images(grid, 100 * trial + number), before)
        found.append(survey.p_chance)
    np.testing.assert_allclose(survey.sigmas, [0.3, 0.3, np.radians(5.0)])  # no less than half a cell
    assert min(found) > 1e-3  # of what is there by chance
    assert max(found) > 0.3


@pytest.mark.parametrize(("side", "is_chance"), [(60, True), (40, False)])
def test_a_large_map_says_itself_what_chance_reaches(monkeypatch, side, is_chance):
    """Streets of another town: no control drive comes near."""
    monkeypatch.setattr("mcl_depth.belief.evidence.chances_of_place", lambda *_: (1e-6, 1e-6))
    grid = grid_of(side)
    proof = Evidence(grid, RATE, SIGMA).survey(Images(grid, 5), np.zeros(3))
    assert (proof.p_chance > RATE, proof.is_proven) == (is_chance, not is_chance)


def test_a_belief_agrees_with_the_best_place_within_what_chance_exceeds_once_in_a_thousand():
    """Of three degrees of freedom: 4.03 deviations."""
    proof = Proof(1e-5, poses=np.array([[4.0, 3.0, 3.1]]))
    for off, agrees in [((1.2, 0.0, 0.0), True), ((0.0, 1.22, 0.0), False), ((0.0, 0.0, np.radians(20.0)), True)]:
        assert proof.agrees_with(proof.poses[0] + off) == agrees
    assert not proof.agrees_with(np.array([4.0, 3.0, 3.1 - np.radians(21.0)]))


def sum_of(joint, field, odometry):
    """The sum of the drive after one more image."""
    return joint.add(field, odometry, np.ones(field.shape[1:], bool))[0]


def joint_of(field, motions):
    """The sum after an image of `field` and images that say nothing, each after one of the motions."""
    joint, pose = JointEvidence(EDGE, 2 * EDGE), np.array([3.0, -1.0, 0.7])
    total = sum_of(joint, field, pose)
    for motion in motions:
        pose = compose_planar(pose[None], np.array(motion))[0]
        total = sum_of(joint, np.zeros_like(field), pose)
    return total


def peak_of(field):
    return tuple(int(i) for i in np.unravel_index(np.argmax(field), field.shape))


def test_evidence_moves_with_odometry():
    field = np.zeros((NUM_HEADINGS, 12, 12), np.float32)
    field[0, 3, 5] = 6.0
    total = joint_of(field, [(2 * EDGE, 0.0, 0.0)])
    assert peak_of(total) == (0, 5, 5)  # two cells ahead
    assert total.max() == pytest.approx(6.0 * FORGETTING)
    assert peak_of(joint_of(field, [(0.0, 0.0, np.pi / 2)])) == (9, 3, 5)
    assert joint_of(field, [(20 * EDGE, 0.0, 0.0)]).max() == 0.0  # off the map


def test_control_drives_look_aside_and_back():
    """Each fits what is seen where the vehicle goes another way than odometry says."""

    def level_of(*to):
        drives, mask = JointEvidence(EDGE, 2 * EDGE), np.ones((12, 12), bool)
        for place, ahead in (((5, 5), 0.0), (to, 2 * EDGE)):
            field = np.zeros((36, 12, 12), np.float32)
            field[0, *place] = 6.0
            _, found = drives.add(field, np.array([ahead, 0.0, 0.0]), mask)
        return found

    ahead, *others = [level_of(*to).turned for to in ((7, 5), (5, 7), (3, 5), (5, 3))]
    assert others == [pytest.approx(6.0 + 2.0 * FORGETTING)] * 3  # of three drives one goes there
    assert ahead == 6.0


def test_a_drive_reaches_from_one_of_its_images_to_another():
    drives, mask, field = JointEvidence(EDGE, 2 * EDGE), np.ones((12, 12), bool), np.zeros((36, 12, 12), np.float32)

    def extent(*odometry):
        return drives.add(field, np.array(odometry), mask)[1].extent_m

    assert [extent(2.0, 1.0, 0.0), extent(5.0, 1.0, 0.0), extent(-1.0, 1.0, 2.0)] == pytest.approx([0.0, 3.0, 6.0])
    assert extent(0.0, 1.0, 0.0) == pytest.approx(6.0)
    assert extent(2.0, 8.0, 0.0) == pytest.approx(np.hypot(3.0, 7.0), rel=0.01)  # in whatever direction
    assert drives.add(field, None, mask)[1].extent_m == 0.0  # nobody knows


def test_odometry_may_err_by_a_cell_and_a_heading():
    field = np.zeros((NUM_HEADINGS, 12, 12), np.float32)
    field[0, 3, 5] = 6.0
    total = joint_of(field, [(2 * EDGE, 0.0, 0.0), (-2 * EDGE, 0.0, 0.0)])  # the second step relaxes
    assert total[0, 4, 5] == total[1, 3, 5] == pytest.approx(FORGETTING * (6.0 * FORGETTING - COST))
    assert total[1, 4, 5] == pytest.approx(FORGETTING * (6.0 * FORGETTING - 2.0 * COST))
    assert total[2, 3, 5] == 0.0


def test_after_a_gap_in_odometry_an_image_stands_alone():
    joint, field = JointEvidence(EDGE, 2 * EDGE), np.zeros((NUM_HEADINGS, 12, 12), np.float32)
    field[0, 3, 5] = 6.0
    sum_of(joint, field, np.zeros(3))
    for odometry in (None, np.array([2 * EDGE, 0.0, 0.0])):
        np.testing.assert_array_equal(sum_of(joint, field, odometry), field)
    assert peak_of(sum_of(joint, np.zeros_like(field), np.array([4 * EDGE, 0.0, 0.0]))) == (0, 5, 5)


def proofs(evidence, grid, seeds, poses, pose_of_belief, odometry):
    """What the evidence says of images that show each pose, or no pose."""
    asked = zip(seeds, poses, odometry, strict=True)
    return [evidence.prove(Images(grid, s, p, 9.0), pose_of_belief, seen(o), is_held=False) for s, p, o in asked]


def place_given():
    grid = grid_of(15)
    evidence = Evidence(grid, RATE, SIGMA)
    evidence.reset(is_given=True)
    return evidence, grid, np.array([4.0, 3.0, 0.0])


def test_a_wrong_place_that_was_given_is_refused_and_the_map_searched():
    evidence, grid, pose = place_given()
    levels = [np.array([0.2 * k, 0.0, 0.0]) for k in range(16)]
    found = proofs(evidence, grid, range(16), [None] * 16, pose, levels)
    assert min(proof.p_chance for proof in found) > RATE
    assert not found[0].is_of_map
    assert found[-1].is_of_map
    assert not evidence.is_on_trial


def test_a_trial_that_stays_open_ends_and_so_does_one_off_the_map():
    evidence, grid, pose = place_given()
    images = [Images(grid, n, pose if n % 2 else None, 9.0) for n in range(MAX_TRIAL)]  # for it and against it
    found = [evidence.prove(image, pose, seen(), is_held=False) for image in images]
    assert [not proof.is_of_map for proof in found] == [True] * (MAX_TRIAL - 1) + [False]
    evidence, grid, pose = place_given()
    beyond = pose + np.array([0.0, 60.0, 0.0])
    found = [evidence.prove(Images(grid, n, beyond, 9.0), beyond, seen(), is_held=False) for n in range(6)]
    assert [not proof.is_of_map for proof in found] == [True] * 4 + [False] * 2


def test_a_held_place_is_doubted_soon_after_the_vehicle_was_carried_off():
    grid = grid_of()
    evidence, pose, away = Evidence(grid, RATE, SIGMA), np.array([6.0, 5.0, 0.0]), np.array([15.0, 12.0, 2.0])

    def doubts(seeds, place):
        return [evidence.prove(Images(grid, s, place, 9.0), pose, seen(), is_held=True).p_chance for s in seeds]

    assert max(doubts(range(40), pose)) < 0.5
    assert np.argmax(np.array(doubts(range(40, 50), away)) > 0.5) in range(2, 5)  # the third to the fifth image


def test_a_place_that_images_do_not_follow_from_is_a_start_on_trial():
    grid, pose = grid_of(), np.array([6.0, 5.0, 0.0])
    evidence = Evidence(grid, RATE, SIGMA)
    evidence.prove(Images(grid, 0, pose, 9.0), pose, seen(), is_held=True)
    lost = evidence.prove(Images(grid, 1, None), pose, seen(finding=SLIP, is_known=False), is_held=True)
    assert evidence.is_on_trial
    assert (lost.is_held, lost.p_chance > 0.1) == (False, True)


@pytest.mark.parametrize(
    ("pose", "num_cells"), [([0.1, 0.1, 0.0], 64), ([9.6, 9.6, 0.0], 225), ([20.4, 9.6, 0.0], 105)]
)
def test_a_place_is_watched_by_the_cells_around_it_that_are_there(pose, num_cells):
    """Of 0.5 m, within 3.75 m either way; one that is 0.4 m off the map still has a cell beside it."""
    grid, asked = grid_of(), []
    images = Images(grid, 3)
    watched = SimpleNamespace(survey=lambda positions: asked.append(len(positions)) or images.survey(positions))
    proof = Evidence(grid, RATE, SIGMA).prove(watched, np.array(pose), seen(), is_held=True)
    assert asked == [num_cells]
    assert 0.0 <= proof.p_chance < 0.5


def test_a_place_off_the_map_is_not_watched():
    proof = Evidence(grid_of(), RATE, SIGMA).prove(None, np.array([30.0, 30.0, 0.0]), seen(), is_held=True)
    assert proof.p_chance == pytest.approx(RATE)
