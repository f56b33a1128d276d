import numpy as np
import pytest

from cycab_sim.world.city import tour

pytestmark = pytest.mark.slow

# Written out: imported, a change would go unseen.
HALF, LANE_X, SQUARE, TOUR_LENGTH = 5.5, 120.0, (70.0, -45.0, 170.0, 55.0), 490.0


def test_the_tour_is_490_m_along_street_square_and_lane():
    path = tour()
    poses = path.at(np.linspace(0.0, path.length, 4901))
    assert path.length == pytest.approx(TOUR_LENGTH)
    assert np.abs(poses[:, 3]).max() <= 1.0 / 6.0  # a steering angle of 0.2 rad
    x0, y0, x1, y1 = SQUARE
    on_square = np.all((poses[:, :2] > [x0, y0]) & (poses[:, :2] < [x1, y1]), axis=1)
    in_lane = (np.abs(poses[:, 0] - LANE_X) < 0.1) & (poses[:, 1] > y1) & (poses[:, 1] < 110.0 - HALF)
    assert 80.0 < on_square.sum() * 0.1 < 110.0
    assert in_lane.sum() * 0.1 == pytest.approx(49.5, abs=0.3)
