"""The motion between two spheres where other boxes stand and light turns the contrast."""

from dataclasses import replace

import numpy as np
import pytest

from sphere_mapping.graph import parts_motion
from sphere_mapping.graph.parts_motion import measure_motion_by_parts
from sphere_mapping.graph.registration import PreparedSphere
from sphere_mapping.params import MapperParams
from sphere_nav.geometry import SE3
from sphere_nav.photometric import register
from worlds.nightfall import DAY, NIGHT, make_sphere

REGISTRATION = MapperParams().registration
T_DAY, T_NIGHT = SE3.from_planar(-1.6, 0.0, 0.0), SE3.from_planar(-1.3, 0.15, 0.06)


def prepared_pair():
    day, night = make_sphere(DAY, T_DAY, is_dark=False), make_sphere(NIGHT, T_NIGHT, is_dark=True)
    return PreparedSphere(day, REGISTRATION), PreparedSphere(night, REGISTRATION)


def test_a_motion_is_measured_where_gray_levels_lead_away():
    a, b = prepared_pair()
    by_levels = register(b.pyramid, [a.at(SE3.identity())], SE3.identity(), REGISTRATION)
    true = T_DAY.inverse() @ T_NIGHT
    assert not by_levels.is_converged or by_levels.T_world_camera.distance(true)[0] > 0.1
    motion = measure_motion_by_parts(a, b, SE3.identity(), REGISTRATION)
    assert motion.T_a_b.distance(true)[0] < 0.03
    assert motion.chance <= 1e-7
    xi = (motion.T_a_b.inverse() @ true).log()
    assert xi @ np.linalg.solve(motion.covariance, xi) < 22.5  # chi^2 of 6 at 0.001


@pytest.mark.slow
def test_both_ways_must_be_proven_and_be_one_motion(monkeypatch):
    a, b = prepared_pair()
    align = parts_motion.align_parts
    for way in (0, 1):  # either way not proven
        calls = []

        def doubtful(*args, way=way, calls=calls):
            calls.append(0)
            found = align(*args)
            return replace(found, chance=1e-6) if len(calls) - 1 == way else found

        monkeypatch.setattr(parts_motion, "align_parts", doubtful)
        assert measure_motion_by_parts(a, b, SE3.identity(), REGISTRATION) is None
    calls = []

    def aside(*args):
        calls.append(0)
        found = align(*args)
        moved = found.T_world_body @ SE3.exp([0.0, 0.2, 0.0, 0.0, 0.0, 0.0])
        return replace(found, T_world_body=moved) if len(calls) == 2 else found

    monkeypatch.setattr(parts_motion, "align_parts", aside)
    assert measure_motion_by_parts(a, b, SE3.identity(), REGISTRATION) is None
    assert len(calls) == 2


def test_it_is_half_way_between_both_ways_and_surely_no_nearer(monkeypatch):
    a, b = prepared_pair()
    apart = SE3.exp([0.004, -0.002, 0.001, 0.0, 0.001, 0.002])
    align, calls = parts_motion.align_parts, []

    def moved(*args):
        found = align(*args)
        calls.append(found.T_world_body)
        return replace(found, T_world_body=calls[0].inverse() @ apart) if len(calls) == 2 else found

    monkeypatch.setattr(parts_motion, "align_parts", moved)
    motion = measure_motion_by_parts(a, b, SE3.identity(), REGISTRATION)
    there, back = calls[0], (calls[0].inverse() @ apart).inverse()
    away = [motion.T_a_b.distance(one)[0] for one in (there, back)]
    assert away[0] == pytest.approx(away[1], rel=1e-3)
    assert away[0] < 0.6 * there.distance(back)[0]
    assert np.all(np.diagonal(motion.covariance)[:3] > away[0] ** 2 / 3)


def test_an_edge_says_what_was_measured():
    motion = measure_motion_by_parts(*prepared_pair(), SE3.identity(), REGISTRATION)
    for is_loop in (False, True):
        edge = motion.edge(4, 9, is_loop=is_loop)
        assert (edge.a, edge.b, edge.is_loop) == (4, 9, is_loop)
        assert edge.T_a_b is motion.T_a_b
        np.testing.assert_allclose(edge.information @ motion.covariance, np.eye(6), atol=1e-6)
