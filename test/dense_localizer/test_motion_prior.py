from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from dense_localizer.inputs import LocalizerInput
from dense_localizer.motion_prior import MapDrift, PosePrior, Prediction, estimate_drift_rate
from dense_localizer.params import PriorParams
from sphere_nav.geometry import SE3
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph

PARAMS = PriorParams()
STEP_NS = 100_000_000
MOTION = SE3.exp([0.1, -0.02, 0.03, 0.02, -0.05, 0.01])
TIGHT = np.diag([1e-4] * 3 + [1e-6] * 3)


def poses(number: int) -> list[SE3]:
    out = [SE3.exp([1.0, 2.0, 3.0, 0.4, 0.2, -0.9])]
    for _ in range(number - 1):
        out.append(out[-1] @ MOTION)
    return out


class Rotations:
    """What images show of the rotation since the last one, where they do not support a motion."""

    def __init__(self, refined=None) -> None:
        self.refined, self.motions = refined, []

    def refine(self, images, T_before_now):
        self.motions.append(T_before_now)
        return self.refined


def moving(rotations: Rotations | None = None) -> tuple[PosePrior, list[SE3]]:
    prior, truth = PosePrior(PARAMS, inter_frame=rotations), poses(6)
    prior.start(truth[0], TIGHT, 0)
    prior.correct(truth[1], TIGHT, STEP_NS)
    return prior, truth


def assert_same(found: SE3, expected: SE3) -> None:
    distance, angle = found.distance(expected)
    assert distance < 1e-9  # rounding of a few compositions
    assert angle < 1e-9


def test_constant_velocity_is_predicted_exactly():
    prior, truth = moving()
    assert_same(prior.predict(2 * STEP_NS).T_map_camera, truth[2])


def test_a_start_stands_still_and_is_unsure():
    prior = PosePrior(PARAMS)
    prior.start(poses(1)[0], TIGHT, 0)
    prediction = prior.predict(STEP_NS)
    assert_same(prediction.T_map_camera, poses(1)[0])
    assert_same(prior.propose(LocalizerInput(STEP_NS)).T_map_camera, poses(1)[0])
    # 5 m/s, 1 rad/s, and the acceleration of 0.1 s
    sigmas = np.repeat([0.5 + 0.5 * PARAMS.acceleration * 0.01, 0.1 + 0.5 * PARAMS.angular_acceleration * 0.01], 3)
    np.testing.assert_allclose(np.diagonal(prediction.covariance), np.diagonal(TIGHT) + sigmas**2)


def test_held_predictions_go_on_and_their_covariance_grows_from_the_last_alignment():
    prior, truth = moving()
    sigmas = []
    for k in range(2, 6):
        prediction = prior.predict(k * STEP_NS)
        prior.hold(prediction)
        assert_same(prediction.T_map_camera, truth[k])
        assert prediction.blind_s == pytest.approx(0.1 * (k - 1))
        sigmas.append(np.sqrt(prediction.covariance[0, 0]))
    growth = 0.5 * PARAMS.acceleration * np.array([0.1, 0.2, 0.3, 0.4]) ** 2
    assert np.all(np.diff(sigmas) > 0)
    assert np.all(np.array(sigmas) >= growth)


def test_covariance_is_carried_into_the_frame_of_the_prediction():
    prior, truth = moving()
    rng = np.random.default_rng(3)
    A = rng.normal(size=(6, 6)) * 1e-3
    prior.correct(truth[1], A @ A.T, STEP_NS)
    prior.velocity = np.array([0, 0, 10.0, 0, 0, np.pi])  # a half turn each second
    prediction = prior.predict(STEP_NS)  # no time: the same covariance
    np.testing.assert_allclose(prediction.covariance, A @ A.T, atol=1e-12)
    samples = rng.multivariate_normal(np.zeros(6), A @ A.T, 20000)
    turned = prior.predict(6 * STEP_NS)
    moved = (turned.T_map_camera.inverse() @ truth[1]) @ SE3.exp(samples)
    errors = (moved @ (truth[1].inverse() @ turned.T_map_camera)).log()
    growth = prior._growth(0.5, None) ** 2
    # 20000 samples: covariances to about 1 %, of the largest element
    expected = turned.covariance - np.diag(growth)
    np.testing.assert_allclose(np.cov(errors.T), expected, atol=0.03 * np.abs(expected).max())


def test_odometry_replaces_velocity():
    prior, truth = moving()
    turn = SE3.exp([0.3, 0, 0, 0, 0, 0.5])
    prior.correct(truth[1], TIGHT, STEP_NS, T_odom_camera=SE3.identity())
    prediction = prior.predict(2 * STEP_NS, T_odom_camera=turn)
    assert_same(prediction.T_map_camera, truth[1] @ turn)
    assert np.sqrt(prediction.covariance[0, 0]) < 0.03  # 5 % of 0.3 m, and the alignment before


def test_odometry_from_before_a_pose_was_found_anew_moves_it_no_more():
    prior, truth = moving()
    prior.correct(truth[1], TIGHT, STEP_NS, T_odom_camera=SE3.identity())
    prior.start(truth[4], TIGHT, 4 * STEP_NS, T_odom_camera=truth[0])
    assert_same(prior.predict(5 * STEP_NS, T_odom_camera=truth[1]).T_map_camera, truth[5])


def test_what_an_image_has_refused_is_not_tried_with_the_next_one():
    """Wheels may be wrong: by velocity until odometry is right again, or that has failed, too."""
    prior, truth = moving()
    stuck, moved = SE3.identity(), MOTION @ MOTION @ MOTION
    prior.correct(truth[1], TIGHT, STEP_NS, T_odom_camera=stuck)

    def propose(number, T_odom_camera=stuck):
        return prior.propose(LocalizerInput(number * STEP_NS, T_odom_camera=T_odom_camera))

    def refuse(number):
        prior.hold(prior.predict(number * STEP_NS, stuck), stuck, is_refused=True)

    assert not propose(2).defies_odometry
    assert_same(propose(2).T_map_camera, truth[1])
    refuse(2)
    assert propose(3).defies_odometry
    assert_same(propose(3).T_map_camera, truth[2])
    prior.correct(truth[3], TIGHT, 3 * STEP_NS, T_odom_camera=stuck)
    assert propose(4).defies_odometry  # it serves, and odometry is as wrong as before
    refuse(4)
    assert not propose(5).defies_odometry  # neither of both: in turn
    refuse(5)
    prior.correct(truth[3] @ moved, TIGHT, 6 * STEP_NS, T_odom_camera=moved)
    assert not propose(7, moved @ MOTION).defies_odometry  # it says what the image has found


def test_an_image_that_nobody_could_see_says_nothing_against_odometry():
    prior, truth = moving()
    prior.correct(truth[1], TIGHT, STEP_NS, T_odom_camera=SE3.identity())
    prior.hold(prior.predict(2 * STEP_NS, MOTION), MOTION)
    prediction = prior.propose(LocalizerInput(3 * STEP_NS, T_odom_camera=MOTION @ MOTION))
    assert not prediction.defies_odometry
    assert_same(prediction.T_map_camera, truth[3])


def test_a_start_trusts_odometry_again_and_a_gap_is_named():
    prior, truth = moving()
    prior.hold(prior.predict(2 * STEP_NS), SE3.identity(), is_refused=True)
    prior.start(truth[2], TIGHT, 2 * STEP_NS, SE3.identity())
    prediction = prior.propose(LocalizerInput(3 * STEP_NS, T_odom_camera=MOTION))
    assert not prediction.defies_odometry
    assert prediction.finding.reason == ""
    assert replace(prediction, step_s=0.5).finding.reason == "GAP"


def test_a_motion_that_images_do_not_support_is_turned_as_they_say():
    turn = SE3.exp([0, 0, 0, 0.2, 0.1, 0])
    rotations = Rotations(refined=turn)
    prior, truth = moving(rotations)
    prior.correct(truth[1], TIGHT, STEP_NS, T_odom_camera=SE3.identity())
    first = prior.propose(LocalizerInput(2 * STEP_NS, T_odom_camera=MOTION))
    assert_same(rotations.motions[0], MOTION)
    expected = truth[1] @ SE3.from_parts(turn.rotation, MOTION.translation)
    assert_same(first.T_map_camera, expected)
    assert first.distance(truth[2], TIGHT) < 1.5  # which of both is right nobody knows


def test_a_pose_that_is_not_by_the_map_makes_the_pose_no_younger():
    prior, truth = moving()
    prior.correct(truth[1], TIGHT, STEP_NS)
    prior.correct(truth[2], TIGHT, 2 * STEP_NS, is_by_map=False)
    assert prior.age(3 * STEP_NS) == pytest.approx(2e-9 * STEP_NS)
    assert_same(prior.last.T_map_camera, truth[2])


def test_a_pose_at_no_later_stamp_moves_the_pose_but_no_velocity():
    prior, truth = moving()
    velocity, covariance = prior.velocity, prior.velocity_covariance
    prior.correct(truth[3], TIGHT, STEP_NS // 2)
    assert_same(prior.last.T_map_camera, truth[3])
    np.testing.assert_array_equal(prior.velocity, velocity)
    np.testing.assert_array_equal(prior.velocity_covariance, covariance)


def test_an_error_that_two_images_share_moves_no_velocity():
    prior, noise = PosePrior(PARAMS), 1e-6 * np.eye(6)
    prior.start(SE3.identity(), TIGHT, 0)
    for k in (1, 2):
        prior.correct(SE3.identity(), 1e-2 * np.eye(6), k * STEP_NS, noise=noise)
    np.testing.assert_allclose(prior.velocity_covariance, 2 * noise / (STEP_NS * 1e-9) ** 2)


def test_a_slow_camera_has_no_gaps_but_where_an_image_is_missing():
    prior, truth = PosePrior(PARAMS), poses(4)
    prior.start(truth[0], TIGHT, 0)
    slow = 10 * STEP_NS
    assert prior.predict(slow).finding.reason == "GAP"  # nobody knows yet
    for k in (1, 2):
        prior.correct(truth[k], TIGHT, k * slow)
    assert prior.predict(3 * slow).finding.reason == ""
    assert prior.predict(5 * slow).finding.reason == "GAP"
    prior.reset()
    with pytest.raises(ValueError, match="expected a started prior"):
        prior.predict(slow)
    prior.start(truth[0], TIGHT, 0)
    assert prior.predict(slow).finding.reason == "GAP"


def test_the_period_is_that_of_the_latest_five():
    prior = PosePrior(PARAMS)
    prior.start(SE3.identity(), TIGHT, 0)
    stamps = np.cumsum([STEP_NS] * 8 + [10 * STEP_NS] * 3)
    for stamp in stamps.tolist():
        prior.correct(SE3.identity(), TIGHT, stamp)
    found = [prior.predict(int(stamps[-1]) + k * STEP_NS).finding.reason for k in (19, 21)]
    assert found == ["", "GAP"]  # three of them took a second


@pytest.mark.parametrize("shared", [0.0, 1.0])
def test_a_pose_with_its_prediction_is_no_surer_than_its_errors_whatever_both_share(shared):
    """Mean NEES of 300 poses: 6, with a deviation of 0.2."""
    rng, here, nees = np.random.default_rng(4), poses(1)[0], []
    measured, predicted = (np.square([*first, 0.01, 0.01, 0.02]) for first in ((0.3, 0.02, 0.02), (0.05, 0.06, 0.03)))
    for _ in range(300):
        one, own = rng.normal(size=(2, 6))
        other = shared * one + (1.0 - shared) * own
        prediction = Prediction(here @ SE3.exp(np.sqrt(predicted) * one), np.diag(predicted), 0, is_trusted=True)
        pose, covariance = prediction.join(here @ SE3.exp(np.sqrt(measured) * other), np.diag(measured))
        assert np.linalg.det(covariance) <= 1.001 * min(np.prod(measured), np.prod(predicted))
        nees.append((xi := (pose.inverse() @ here).log()) @ np.linalg.solve(covariance, xi))
    assert 2.0 < np.mean(nees) < 6.6


def test_a_prediction_from_a_pose_that_nobody_trusts_adds_nothing():
    here, there = poses(1)[0], poses(1)[0] @ SE3.exp([0.01, 0.0, 0.0, 0.0, 0.0, 0.0])
    for prediction in (Prediction(here, TIGHT, 0), Prediction.guess(here)):
        pose, covariance = prediction.join(there, 4.0 * TIGHT)
        assert_same(pose, there)
        np.testing.assert_array_equal(covariance, 4.0 * TIGHT)


SIGMA = np.repeat([0.004, 0.002], 3)


def graph_of(poses) -> SphereGraph:
    edges = [Edge(k, k + 1, a.inverse() @ b, np.diag(1.0 / SIGMA**2)) for k, (a, b) in enumerate(pairwise(poses))]
    return SphereGraph([KeySphere(k, 1 + k, pose) for k, pose in enumerate(poses)], edges)


def test_a_meter_errs_as_the_edges_say():
    assert estimate_drift_rate(SphereGraph([])) == pytest.approx(np.repeat([0.002, 0.0015], 3) ** 2)
    graph = graph_of([SE3.from_planar(2.0 * k, 0.0, 0.0) for k in range(4)])
    np.testing.assert_allclose(estimate_drift_rate(graph), 2.0 * SIGMA**2 / 2.0)


def test_drift_is_as_large_as_that_of_random_maps():
    poses = [SE3.from_planar(1.0 * k, 0.05 * k * k, 0.1 * k) for k in range(9)]
    drift, rng = MapDrift(graph_of(poses)), np.random.default_rng(2)
    drift.reset()
    drift.propagate(poses[0])
    for pose in poses[1:]:
        drift.propagate(pose)
    steps, sigma = [a.inverse() @ b for a, b in pairwise(poses)], np.sqrt(drift.per_meter)
    T = poses[0]
    for step in steps:
        T = T @ step @ SE3.exp(rng.normal(0, sigma * np.sqrt(np.linalg.norm(step.translation)), (4000, 6)))
    ends = (poses[-1].inverse() @ T).log()
    np.testing.assert_allclose(drift.covariance, np.cov(ends.T), atol=0.1 * drift.covariance.max())


def test_standing_still_adds_nothing_and_a_start_forgets():
    drift = MapDrift(graph_of([SE3.identity(), SE3.from_planar(1.0, 0.0, 0.0)]))
    drift.reset()
    drift.propagate(SE3.identity())
    drift.propagate(SE3.from_planar(3.0, 0.0, 0.0))
    before = drift.covariance
    for _ in range(5):
        drift.propagate(SE3.from_planar(3.0, 0.0, 0.0))
    np.testing.assert_array_equal(drift.covariance, before)
    assert before[0, 0] > 0.0
    drift.reset()
    drift.propagate(SE3.identity())
    assert not drift.covariance.any()
