from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sphere_mapping.graph.both_ways import (
    FEATURES,
    ONE_WAY,
    agree,
    confirm,
    find_motion,
    is_denied,
    measure_motion,
    measure_motion_by_parts,
    why_denied,
)
from sphere_mapping.graph.registration import PreparedSphere, align_sphere
from sphere_mapping.params import REGISTRATION
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.photometric import register
from sphere_nav.spheres.appearance.pose import FeaturePose
from worlds.nightfall import DAY, NIGHT, make_sphere
from worlds.room import sharp_room

MAX_GAP = (0.05, 0.02)

PARAMS = REGISTRATION
CAMERA = Spherical(256, 128)
ROOM = sharp_room()
HERE = SE3.exp([0.5, -0.4, 0.0, 0.0, 0.0, 0.3])
MOTION = SE3.exp([0.3, -0.2, 0.05, 0.0, 0.02, 0.1])
A = PreparedSphere(ROOM.sphere(HERE, CAMERA, 1))
B = PreparedSphere(ROOM.sphere(HERE @ MOTION, CAMERA, 2))


def test_a_motion_is_measured_with_an_honest_covariance():
    found = measure_motion(A, B, SE3.exp([0.25, -0.1, 0.0, 0.0, 0.0, 0.12]))
    assert found is not None
    error = (MOTION.inverse() @ found.T_a_b).log()
    assert np.linalg.norm(error[:3]) < 0.01
    assert np.linalg.norm(error[3:]) < np.radians(0.2)
    np.testing.assert_allclose(found.covariance, found.covariance.T)
    assert error @ np.linalg.solve(found.covariance, error) < 16.8  # chi2 of 6, 99 %
    edge = found.edge(3, 7, is_loop=True)
    assert (edge.a, edge.b, edge.is_loop) == (3, 7, True)
    np.testing.assert_allclose(edge.information @ found.covariance, np.eye(6), atol=1e-6)


def test_no_pair_with_a_wrong_first_guess_is_accepted_wrongly(rng):
    num_accepted = 0
    for _ in range(25):
        direction, axis = rng.normal(size=(2, 3))
        off = np.concatenate(
            [
                direction / np.linalg.norm(direction) * rng.uniform(0, 5),
                axis / np.linalg.norm(axis) * rng.uniform(0, np.pi / 2),
            ]
        )
        found = measure_motion(A, B, MOTION @ SE3.exp(off))
        if found is not None:
            num_accepted += 1
            distance, angle = found.T_a_b.distance(MOTION)
            assert distance < 0.1
            assert angle < np.radians(1.0)
    assert num_accepted > 0


def test_two_ways_that_disagree_are_no_motion_and_widen_it_where_they_nearly_agree():
    forward = align_sphere(B, [A.at(SE3.identity())], [MOTION])
    exact = replace(forward, T_world_camera=forward.T_world_camera.inverse())
    shifted = [replace(exact, T_world_camera=exact.T_world_camera @ SE3.exp([x, 0, 0, 0, 0, 0])) for x in (0.03, 0.2)]
    assert agree(forward, shifted[1]) is None
    sure, unsure = agree(forward, exact), agree(forward, shifted[0])
    assert sure is not None
    assert unsure is not None
    assert np.trace(unsure.covariance[:3, :3]) > 2 * np.trace(sure.covariance[:3, :3])
    assert 0.01 < unsure.T_a_b.distance(sure.T_a_b)[0] < MAX_GAP[0] / 2  # half way


def test_a_way_back_that_is_unsure_along_the_street_makes_a_turned_sphere_unsure_along_it():
    turned = SE3.from_planar(0.0, 0.0, 0.6)
    forward = SimpleNamespace(T_world_camera=turned, covariance=np.zeros((6, 6)))
    back = SimpleNamespace(T_world_camera=turned.inverse(), covariance=np.diag([2.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    found = agree(forward, back).covariance[:3, :3]
    along, across, _ = turned.rotation
    assert across @ found @ across < 0.01 < 0.99 < along @ found @ along


def test_another_room_confirms_nothing():
    other = PreparedSphere(sharp_room(seed=5).sphere(HERE @ MOTION, CAMERA))
    forward = align_sphere(B, [A.at(SE3.identity())], [MOTION])
    assert confirm(A, B, forward) is not None
    assert confirm(A, other, forward) is None
    assert measure_motion(A, other, MOTION) is None


def test_features_are_heard_only_where_there_are_enough():
    for num_inliers, is_wrong in [(4, False), (60, True)]:
        found = measure_motion(A, B, MOTION)
        assert found is not None
        elsewhere = FeaturePose(SE3.identity(), num_inliers)
        assert is_denied(found.T_a_b, elsewhere) == is_wrong
        assert not is_denied(found.T_a_b, None)


FAR = SE3.exp([-0.9, 0.7, 0.1, 0.0, 0.05, 1.9])  # a stride and a half turn, of which nothing is known


@pytest.mark.slow
def test_a_motion_of_which_nothing_is_known_is_found_and_proven():
    c = PreparedSphere(ROOM.sphere(HERE @ FAR, Spherical(512, 256), 3))
    a = PreparedSphere(ROOM.sphere(HERE, Spherical(512, 256), 1))
    assert register(c.pyramid, [a.at(SE3.identity())], SE3.identity(), PARAMS).T_world_camera.distance(FAR)[0] > 0.3
    found = find_motion(a, c)
    assert found is not None
    assert found.T_a_b.distance(FAR)[0] < 0.01
    assert found.T_a_b.distance(FAR)[1] < np.radians(0.2)
    wrong = replace(c.sphere, range_m=(1.5 * c.sphere.range_m).astype(np.float32))
    assert find_motion(a, PreparedSphere(wrong)) is None  # the way back goes elsewhere


def test_what_nothing_foretold_is_held_against_the_way_back_and_against_features():
    forward = align_sphere(B, [A.at(SE3.identity())], [MOTION])
    wrong = replace(forward, T_world_camera=MOTION @ SE3.exp([0.5, 0.0, 0.0, 0.0, 0.0, 0.0]))
    bare = PreparedSphere(replace(B.sphere, range_m=np.full_like(B.sphere.range_m, np.nan)))
    for is_expected in (True, False):
        assert why_denied(A, B, forward, is_expected=is_expected) == ""
        assert why_denied(A, B, wrong, is_expected=is_expected) == ONE_WAY
        assert why_denied(A, bare, forward, is_expected=is_expected) == ""  # no range, no way back
        assert why_denied(A, bare, wrong, is_expected=is_expected) == ("" if is_expected else FEATURES)


T_DAY, T_NIGHT = SE3.from_planar(-1.6, 0.0, 0.0), SE3.from_planar(-1.3, 0.15, 0.06)


def prepared_pair():
    day, night = make_sphere(DAY, T_DAY, is_dark=False), make_sphere(NIGHT, T_NIGHT, is_dark=True)
    return PreparedSphere(day), PreparedSphere(night)


def test_a_motion_is_measured_where_gray_levels_lead_away():
    a, b = prepared_pair()
    by_levels = register(b.pyramid, [a.at(SE3.identity())], SE3.identity(), REGISTRATION)
    true = T_DAY.inverse() @ T_NIGHT
    assert not by_levels.is_converged or by_levels.T_world_camera.distance(true)[0] > 0.1
    motion = measure_motion_by_parts(a, b, SE3.identity())
    assert motion.T_a_b.distance(true)[0] < 0.03
    xi = (motion.T_a_b.inverse() @ true).log()
    assert xi @ np.linalg.solve(motion.covariance, xi) < 22.5  # chi^2 of 6 at 0.001


def test_an_edge_says_what_was_measured():
    motion = measure_motion_by_parts(*prepared_pair(), SE3.identity())
    for is_loop in (False, True):
        edge = motion.edge(4, 9, is_loop=is_loop)
        assert (edge.a, edge.b, edge.is_loop) == (4, 9, is_loop)
        assert edge.T_a_b is motion.T_a_b
        np.testing.assert_allclose(edge.information @ motion.covariance, np.eye(6), atol=1e-6)
