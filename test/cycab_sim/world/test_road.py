"""The road of 1 km and the open square: what lies beside their ways."""

import numpy as np
import pytest

from cycab_sim.world.road import HALF_ROAD, WALL, build_road, road_path

# Written out: imported, a change would go unseen.
LANE, SQUARE = 1.75, (-105.0, -85.0, 105.0, 85.0)


def test_the_road_has_a_kilometre_that_a_car_drives_at_14_meters_a_second():
    way, middle = road_path(), road_path(0.0)
    assert middle.length == pytest.approx(1000.0, abs=0.1)
    assert abs(way.length - middle.length) < 2.0
    poses = way.at(np.arange(0.0, way.length, 1.0))
    assert np.abs(poses[:, 3]).max() * 13.9**2 < 2.6  # m/s^2 across
    assert {1.0, -1.0} <= set(np.sign(poses[:, 3]))
    for s in (0.0, 100.0, 190.0, 300.0, 400.0, 560.0, 640.0, 990.0):  # in straights and in bends of both kinds
        x, y = middle.at(s)[:2]
        across = np.hypot(*(way.at(np.linspace(s - 20.0, s + 20.0, 4001))[:, :2] - [x, y]).T).min()
        assert across == pytest.approx(LANE, abs=0.01)


@pytest.mark.slow
def test_houses_leave_the_road_free_on_both_sides_and_in_its_bends():
    triangles = build_road(3).triangles
    high = triangles[triangles[..., 2].min(axis=1) > 2.5]  # of houses: above cars, boxes and benches
    corners = high.reshape(-1, 3)[:, :2]
    for s in np.arange(2.0, 1000.0, 23.0):
        x, y, heading, _ = road_path(0.0).at(s)
        off = corners - [x, y]
        along = off @ [np.cos(heading), np.sin(heading)]
        across = (off @ [-np.sin(heading), np.cos(heading)])[np.abs(along) < 3.0]
        near = across[np.abs(across) < WALL + 12.0]
        assert np.abs(near).min() > HALF_ROAD - 1.9  # trees reach over the kerb
        assert near.min() < -WALL or near.max() > WALL
