import numpy as np
import pytest

from cycab_sim.world.town import draw_plan, path_names, taught_path

CLEARANCE = 0.6 + 0.3  # half the width of the car, and what a driver leaves


def test_the_taught_path_is_100_m_with_two_turns():
    for seed in range(8):
        path = taught_path(draw_plan(seed), "two_turns")
        poses = path.at(np.linspace(0, path.length, 2001))
        assert path.length == pytest.approx(100.0)
        assert poses[-1, 2] - poses[0, 2] == pytest.approx(np.pi)
        assert np.abs(poses[:, 3]).max() == pytest.approx(0.2)  # radius 5 m: a steering angle of 0.24 rad
        assert np.sum(np.diff(poses[:, 3]) > 0.1) == 2


def test_the_block_is_closed_and_other_names_are_refused():
    plan = draw_plan(2)
    path = taught_path(plan, "block")
    start, end = path.at(np.array([0.0, path.length - 1e-9]))
    np.testing.assert_allclose(end[:2], start[:2], atol=1e-6)
    assert path.length > 120.0
    with pytest.raises(ValueError, match="two_turns, block, straight, found 'moon'"):
        taught_path(plan, "moon")


@pytest.mark.slow
def test_nothing_stands_in_the_way(town_renderer, town):
    for name in path_names():
        path = taught_path(town[1], name)
        angles = np.radians(np.arange(0, 360, 5))
        rays = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1).astype(np.float32)
        for s in np.arange(0.0, path.length, 1.0):
            x, y, _, _ = path.at(np.array(s))
            for z in (0.3, 0.9, 1.7):
                triangles, ranges = np.empty(72, np.int32), np.empty(72, np.float32)
                town_renderer._cast(np.array([x, y, z]), rays, triangles, ranges)
                assert ranges.min() > CLEARANCE, f"{name} at {s} m, height {z} m"
