import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.geometry.odometry import OdometryBuffer

TWIST = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.5])
STEP_NS = 20_000_000


def pose(stamp_ns: int) -> SE3:
    return SE3.exp(TWIST * stamp_ns * 1e-9)


@pytest.fixture
def buffer():
    buffer = OdometryBuffer(max_age_s=0.1)
    for k in range(1, 6):
        buffer.add(k * STEP_NS, pose(k * STEP_NS), TWIST)
    return buffer


def test_a_steady_motion_is_interpolated_and_carried_on_and_back(buffer):
    for stamp_ns in [-75_000_000, 0, STEP_NS, 45_000_000, 99_000_000, 100_000_000, 150_000_000]:
        assert len(buffer) == 5
        np.testing.assert_allclose(buffer.at(stamp_ns).matrix, pose(stamp_ns).matrix, atol=1e-12)


def test_long_before_the_first_and_long_after_the_last_nothing_is_known(buffer):
    for stamp_ns in [-81_000_000, 201_000_000]:
        assert buffer.at(stamp_ns) is None


def test_a_stamp_that_does_not_grow_is_refused(buffer):
    with pytest.raises(ValueError, match=r"later than 0\.100 s, found 0\.100 s"):
        buffer.add(5 * STEP_NS, pose(0), TWIST)
    buffer.clear()
    assert buffer.at(5 * STEP_NS) is None
