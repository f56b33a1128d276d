"""The motion between two spheres of a room, as plain values."""

from dataclasses import replace

import numpy as np
import pytest

from sphere_mapping.params import MapperParams
from sphere_nav.geometry import SE3
from sphere_nav_tools.offline.registering import describe_refusal, finite, register_spheres
from worlds.localizer import make_map
from worlds.room import wide_room


@pytest.mark.slow
def test_a_known_motion_is_found():
    T = SE3.from_planar(0.2, -0.1, 0.05)
    a, b = (node.sphere for node in make_map(wide_room(), [SE3.identity(), T]).graph)
    found = register_spheres(a, b, SE3.identity(), MapperParams())
    assert found["is_converged"]
    assert found["T_a_b"]["translation_m"] == pytest.approx(T.translation, abs=0.005)
    assert found["T_a_b"]["angle_deg"] == pytest.approx(np.degrees(0.05), abs=0.1)
    assert found["residual"]["mad"] < found["residual_at_guess"]["mad"]


def test_json_has_no_infinity():
    assert finite(np.array([[1.0, np.inf], [np.nan, 2.0]])) == [[1.0, None], [None, 2.0]]


@pytest.mark.slow
def test_a_motion_may_be_large_and_a_wrong_one_is_not_converged():
    T = SE3.from_planar(1.2, -0.7, 1.3)
    a, b = (node.sphere for node in make_map(wide_room(), [SE3.identity(), T]).graph)
    found = register_spheres(a, b, SE3.identity(), MapperParams())
    assert found["is_converged"]
    assert found["T_a_b"]["translation_m"] == pytest.approx(T.translation, abs=0.01)
    wrong = replace(b, range_m=(2.0 * b.range_m).astype(np.float32))
    refused = register_spheres(a, wrong, SE3.identity(), MapperParams())
    assert not refused["is_converged"]
    assert refused["reason"]
    assert "odometry" in describe_refusal(refused["reason"])
    assert describe_refusal("ONE_WAY").startswith("refused (ONE_WAY): the way back disagrees; smaller steps")
