"""The motion between two spheres where other boxes stand and light turns the contrast."""

import numpy as np

from sphere_mapping.graph.parts_motion import measure_motion_by_parts
from sphere_mapping.graph.registration import PreparedSphere
from sphere_mapping.params import REGISTRATION
from sphere_nav.geometry import SE3
from sphere_nav.photometric import register
from worlds.nightfall import DAY, NIGHT, make_sphere

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
