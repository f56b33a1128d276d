"""The test for chance: exact where nothing is there to be found, sharp where the true place is among the rest."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from mcl_depth.belief.estimate import Observation
from mcl_depth.belief.evidence import Evidence, Proof, chance_of_lead, chances_of_place
from mcl_depth.belief.image_motion import Reconciled
from mcl_depth.belief.joint_evidence import JointEvidence, SurveyGrid
from mcl_depth.belief.motion_model import compose_planar, relative_motion
from sphere_nav.geometry import Spherical
from sphere_nav.localization.status import FINE, Reason, Verdict

COST = np.float32(2.5)
FORGETTING = np.float32(0.97)
MAX_TRIAL = 12
RIVAL_SCALE = 0.6

SLIP = Verdict(Reason.JUMP_REJECTED)
EDGE, SIDE, NUM_HEADINGS, RATE, SCALE = 0.5, 40, 36, 1e-3, 2.4


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


def test_a_place_leads_both_its_rivals_and_what_a_drive_elsewhere_reaches():
    values, rival = np.array([32.0, 8.0, 8.0, 4.0, 4.0]), np.array([32.0, 29.0, -5.0, 0.0, 0.0])  # 6 in the mean
    p_elsewhere, p_chance = chances_of_place(values, 10.0, 8.0, 2.2)
    assert p_elsewhere == p_chance == pytest.approx(np.exp(-(32.0 - 17.5 + 8.0 - 3.0) / 2.2))  # the rival is far behind
    assert chances_of_place(rival, 10.0, 8.0, 2.2) == pytest.approx((p_elsewhere, np.exp(-3.0 / RIVAL_SCALE)))
    assert chances_of_place(rival, 10.0, 4.0, 2.2)[1] == pytest.approx(np.exp(-1.5 / RIVAL_SCALE))  # a twin next door
    wide = [chances_of_place(values, 10.0, extent_m, 2.2)[0] for extent_m in (8.0, 12.0, 40.0)]
    assert wide[1] == wide[2] == pytest.approx(np.exp(-4.0 / 2.2) * wide[0])  # images of one room err together
    assert chances_of_place(values, 12.0, 8.0, 2.2)[0] == pytest.approx(np.exp(3.5 / 2.2) * p_elsewhere)  # of more
    assert chances_of_place(values, 30.0, 8.0, 2.2) == (1.0, 1.0)
    assert chances_of_place(values[:1], 10.0, 8.0, 2.2) == (1.0, 1.0)  # no rival


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
        evidence = Evidence(grid, RATE, SCALE)
        for number, before in enumerate(odometry):
            survey = evidence.survey(Images(grid, 100 * trial + number), before)
        found.append(survey.p_chance)
    np.testing.assert_allclose(survey.sigmas, [0.3, 0.3, np.radians(5.0)])  # no less than half a cell
    assert min(found) > 1e-3  # of what is there by chance
    assert max(found) > 0.3


@pytest.mark.parametrize(("side", "is_chance"), [(60, True), (40, False)])
def test_a_large_map_says_itself_what_chance_reaches(monkeypatch, side, is_chance):
    """Streets of another town fit better than rooms of another home."""
    monkeypatch.setattr("mcl_depth.belief.evidence.chances_of_place", lambda *_: (1e-6, 1e-6))
    grid = grid_of(side)
    proof = Evidence(grid, RATE, SCALE).survey(Images(grid, 5), np.zeros(3))
    assert (proof.p_chance > RATE, proof.is_proven) == (is_chance, not is_chance)


def test_a_belief_agrees_with_the_best_place_within_what_chance_exceeds_once_in_a_thousand():
    """Of three degrees of freedom: 4.03 deviations."""
    proof = Proof(1e-5, poses=np.array([[4.0, 3.0, 3.1]]))
    for off, agrees in [((1.2, 0.0, 0.0), True), ((0.0, 1.22, 0.0), False), ((0.0, 0.0, np.radians(20.0)), True)]:
        assert proof.agrees_with(proof.poses[0] + off) == agrees
    assert not proof.agrees_with(np.array([4.0, 3.0, 3.1 - np.radians(21.0)]))


def joint_of(field, motions):
    """The sum after an image of `field` and images that say nothing, each after one of the motions."""
    joint, pose = JointEvidence(EDGE, 2 * EDGE), np.array([3.0, -1.0, 0.7])
    total, *_ = joint.add(field, pose)
    for motion in motions:
        pose = compose_planar(pose[None], np.array(motion))[0]
        total, *_ = joint.add(np.zeros_like(field), pose)
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


def test_an_image_counts_by_its_way_and_earlier_ones_less_for_it():
    joint, field = JointEvidence(EDGE, 2 * EDGE), np.zeros((NUM_HEADINGS, 12, 12), np.float32)
    ways = [0.0, 2 * EDGE, 2 * EDGE, 3 * EDGE]  # m driven: nothing, a full way, nothing, half of one
    numbers = [joint.add(field, np.array([way, 0.0, 0.0]))[1] for way in ways]
    assert numbers == pytest.approx(
        [1.0, 1.0 + FORGETTING, 1.0 + FORGETTING, 0.5 + FORGETTING**0.5 * (1.0 + FORGETTING)]
    )
    assert joint.add(field, None)[1] == 1.0


def test_a_drive_reaches_from_one_of_its_images_to_another():
    joint, field = JointEvidence(EDGE, 2 * EDGE), np.zeros((NUM_HEADINGS, 12, 12), np.float32)

    def extent(*odometry):
        return joint.add(field, np.array(odometry))[2]

    assert [extent(2.0, 1.0, 0.0), extent(5.0, 1.0, 0.0), extent(-1.0, 1.0, 2.0)] == pytest.approx([0.0, 3.0, 6.0])
    assert extent(0.0, 1.0, 0.0) == pytest.approx(6.0)
    assert extent(2.0, 8.0, 0.0) == pytest.approx(np.hypot(3.0, 7.0), rel=0.01)  # in whatever direction
    assert joint.add(field, None)[2] == 0.0  # nobody knows
    assert extent(9.0, 9.0, 0.0) == pytest.approx(0.0, abs=1e-9)


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
    joint.add(field, np.zeros(3))
    for odometry in (None, np.array([2 * EDGE, 0.0, 0.0])):
        np.testing.assert_array_equal(joint.add(field, odometry)[0], field)
    assert peak_of(joint.add(np.zeros_like(field), np.array([4 * EDGE, 0.0, 0.0]))[0]) == (0, 5, 5)


def proofs(evidence, grid, seeds, poses, pose_of_belief, odometry):
    """What the evidence says of images that show each pose, or no pose."""
    asked = zip(seeds, poses, odometry, strict=True)
    return [evidence.prove(Images(grid, s, p, 9.0), pose_of_belief, seen(o), is_held=False) for s, p, o in asked]


def place_given():
    grid = grid_of(15)
    evidence = Evidence(grid, RATE, SCALE)
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
    evidence, pose, away = Evidence(grid, RATE, SCALE), np.array([6.0, 5.0, 0.0]), np.array([15.0, 12.0, 2.0])

    def doubts(seeds, place):
        return [evidence.prove(Images(grid, s, place, 9.0), pose, seen(), is_held=True).p_chance for s in seeds]

    assert max(doubts(range(40), pose)) < 0.5
    assert np.argmax(np.array(doubts(range(40, 50), away)) > 0.5) in range(2, 5)  # the third to the fifth image


def test_a_place_that_images_do_not_follow_from_is_a_start_on_trial():
    grid, pose = grid_of(), np.array([6.0, 5.0, 0.0])
    evidence = Evidence(grid, RATE, SCALE)
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
    proof = Evidence(grid, RATE, SCALE).prove(watched, np.array(pose), seen(), is_held=True)
    assert asked == [num_cells]
    assert 0.0 <= proof.p_chance < 0.5


def test_a_place_off_the_map_is_not_watched():
    proof = Evidence(grid_of(), RATE, SCALE).prove(None, np.array([30.0, 30.0, 0.0]), seen(), is_held=True)
    assert proof.p_chance == pytest.approx(RATE)
