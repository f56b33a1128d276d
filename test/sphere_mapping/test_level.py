"""Which way is up where a map begins."""

import numpy as np
import pytest

from sphere_mapping.level import BY_GROUND, BY_ORIENTATION, BY_REST, UP, ImuSample, Upright, find_gravity, find_ground
from sphere_nav.geometry import SE3, so3

LEAN = SE3.from_angles(0.03, -0.08, 0.0, [0.0, 0.0, 0.0]).rotation  # level axes <- base
EYE = np.array([0.3, 0.0, 1.4])


def samples(rng, R_world_imu, *, force=(0.0, 0.0, 9.81), rate=0.0, has_orientation=False, count=50):
    up = R_world_imu.T @ UP
    forces = np.broadcast_to(force, (count, 3)) @ R_world_imu + 0.03 * rng.standard_normal((count, 3))
    rates = rate + 0.002 * rng.standard_normal((count, 3))
    return [ImuSample(k, forces[k], rates[k], up if has_orientation else None) for k in range(count)]


@pytest.mark.parametrize("roll", [np.pi / 2, np.pi])
def test_an_imu_at_rest_says_which_way_is_up_however_it_is_mounted(rng, roll):
    R_base_imu = so3.exp([roll, 0.0, 0.0]) @ so3.exp([0.0, 0.0, 0.7])
    level = find_gravity(samples(rng, LEAN @ R_base_imu), R_base_imu)
    assert level.source == BY_REST
    np.testing.assert_allclose(level.up_base, LEAN.T @ UP, atol=2e-3)


def test_in_motion_only_the_orientation_of_an_imu_counts(rng):
    start = np.linspace(0.0, 1.0, 50)[:, None] * [1.0, 0.0, 0.0] + [0.0, 0.0, 9.81]
    for moving in ({"force": start}, {"force": (0.0, 0.0, 10.5)}, {"rate": 0.2}):
        assert find_gravity(samples(rng, LEAN, **moving), np.eye(3)) is None
        level = find_gravity(samples(rng, LEAN, has_orientation=True, **moving), np.eye(3))
        assert level.source == BY_ORIENTATION
        np.testing.assert_allclose(level.up_base, LEAN.T @ UP, atol=1e-9)


def test_the_map_begins_at_the_base_level_and_ahead():
    T_map_base = Upright(LEAN.T @ UP).T_map_base
    np.testing.assert_allclose(T_map_base.rotation @ (LEAN.T @ UP), UP, atol=1e-12)
    assert (float(T_map_base.yaw), *T_map_base.translation) == pytest.approx((0.0, 0.0, 0.0, 0.0), abs=1e-12)
    np.testing.assert_allclose(T_map_base.angles[:2], SE3.from_parts(LEAN, np.zeros(3)).angles[:2], atol=1e-9)
    np.testing.assert_array_equal(Upright(UP).T_map_base.matrix, np.eye(4))


def scene(rng, up_base):
    """Points (N, 3) of a floor 1.4 m below the eye, and of a wall ahead."""
    floor = np.column_stack([rng.uniform(1, 6, 6000), rng.uniform(-2, 2, 6000), np.zeros(6000)])
    wall = np.column_stack([np.full(6000, 6.0), rng.uniform(-2, 2, 6000), rng.uniform(0, 3, 6000)])
    points = np.concatenate([floor, wall]) @ Upright(up_base).T_map_base.rotation
    away = points - EYE
    return points + 0.01 * rng.standard_normal((len(points), 1)) * away / np.linalg.norm(away, axis=1, keepdims=True)


def test_the_ground_corrects_a_mounting_that_leans(rng):
    level = find_ground(scene(rng, LEAN.T @ UP), EYE, 0.25)
    assert level.source == BY_GROUND
    np.testing.assert_allclose(level.up_base, LEAN.T @ UP, atol=3e-3)


def test_the_ground_says_nothing_of_a_lean_that_its_own_error_explains(rng):
    for lean in (0.0, 0.005):
        assert find_ground(scene(rng, so3.exp([0.0, lean, 0.0]) @ UP), EYE, 0.25) is None


def test_neither_a_wall_nor_a_plane_with_something_below_is_the_ground(rng):
    wall = rng.uniform([6, -2, 0], [6.001, 2, 3], (9000, 3))
    assert find_ground(wall, EYE, 0.25) is None
    shelf = scene(rng, LEAN.T @ UP) + 0.8 * UP
    below = rng.uniform([1, -2, -0.6], [6, 2, -0.5], (1500, 3))
    below[:, 2] += 0.3 * rng.standard_normal(1500)
    assert find_ground(np.concatenate([shelf, below]), EYE, 0.25) is None
