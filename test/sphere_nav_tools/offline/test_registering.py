"""The motion between two spheres of a room, as plain values."""

from dataclasses import replace

import numpy as np
import pytest

from sphere_mapping.params import MapperParams
from sphere_nav.geometry import SE3
from sphere_nav_tools.offline.registering import describe_refusal, register_spheres
from worlds.localizer import make_map
from worlds.room import wide_room


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
