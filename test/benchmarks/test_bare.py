"""What the benchmarks of bare geometry compute by themselves: ways, odometry, scores; homes that are drawn."""

import numpy as np
import pytest

from benchmarks.bare.drives import MARGIN, MAX_OFFSET, SIDE, Drive, Studio, kidnapped_line, limits
from benchmarks.bare.trials import Trial
from cycab_sim.world.town import draw_plan
from sphere_nav.geometry import SE3, so3
from sphere_nav.localization.status import State

PLAN = draw_plan(4)


def trial(meters, states):
    count = len(meters)
    zeros = np.zeros(count)
    return Trial(tuple(states), ("",) * count, np.array(meters, float), zeros, zeros)


def test_kidnapped_lines_follow_the_streets_inside_the_square():
    x0, y0, x1, y1 = limits(PLAN)
    assert x1 - x0 == y1 - y0 == SIDE
    turned = 0
    for seed in range(40):
        line = kidnapped_line(PLAN, 20, 1.0, np.random.default_rng(seed))
        assert np.all((line[:, 0] > x0 + MARGIN) & (line[:, 0] < x1 - MARGIN))
        assert np.all((line[:, 1] > y0 + MARGIN) & (line[:, 1] < y1 - MARGIN))
        chords = np.linalg.norm(np.diff(line[:, :2], axis=0), axis=1)
        assert np.all((chords > 0.99) & (chords < 1.0 + 1e-9))  # an arc of 5 m: the chord of 1 m is 1.7 mm shorter
        ends = line[[0, -1], :2]
        aside = np.minimum(np.abs(ends[:, :1] - [0.0, PLAN.east]).min(axis=1),
                           np.abs(ends[:, 1:] - [0.0, PLAN.north]).min(axis=1))  # fmt: skip
        assert aside[0] <= MAX_OFFSET + 1e-9
        turned += abs(line[-1, 2] - line[0, 2]) > 0.1
    assert 5 < turned < 40  # two choices of three turn, where a crossing is near enough


def test_a_trial_counts_only_tracking_at_the_right_place():
    follow = [State.SEARCHING, State.TRACKING, State.DEGRADED, State.TRACKING, State.TRACKING]
    good = trial([9.0, 5.0, 0.2, 0.2, 0.1], follow)
    assert good.has_converged
    assert good.num_false == 1
    assert not trial([0.1, 0.1], [State.TRACKING, State.PROBATION]).has_converged


def test_odometry_and_tilt_of_a_drive_are_near_the_truth(monkeypatch):
    monkeypatch.setattr(
        Studio, "_images", lambda self, poses, light, seed: np.zeros((len(poses.matrix), 2, 2), np.uint8)
    )
    line = np.column_stack([np.linspace(10.0, 50.0, 41), np.zeros(41), np.zeros(41)])
    drive = Studio("ramp", 3).record(line, 5)
    way = np.linalg.norm(drive.odometry[-1, :2])
    assert 36.0 < way < 44.0
    assert not np.isclose(way, 40.0, atol=1e-6)
    pitch = np.arcsin(-drive.tilts[20][2, 0])  # x = 30 m, on the ramp
    assert np.degrees(pitch) == pytest.approx(-np.degrees(np.arctan(0.08)), abs=1.0)  # noise 0.2 deg
    again = Studio("ramp", 3).record(line, 5)
    np.testing.assert_array_equal(drive.odometry, again.odometry)


def seen(images, *turns):
    """A drive of a panorama on flat ground whose IMU leans by rotation vectors."""
    odometry = np.array([[0.0, 0.0, 0.1], [1.0, 0.2, 0.3]])
    return Drive(images, SE3.from_matrix(np.tile(np.eye(4), (2, 1, 1))), odometry, np.stack(turns))


def test_a_mirrored_drive_turns_the_other_way_and_leans_to_the_other_side():
    images = np.arange(2 * 3 * 8, dtype=np.uint8).reshape(2, 3, 8)
    drive = seen(images, so3.exp(np.array([0.1, 0.0, 0.0])), so3.exp(np.array([0.0, 0.2, 0.0])))
    mirrored = drive.mirrored
    np.testing.assert_array_equal(mirrored.images[0, 0], images[0, 0, ::-1])
    np.testing.assert_allclose(mirrored.odometry, [[0.0, 0.0, -0.1], [1.0, -0.2, -0.3]])
    np.testing.assert_allclose(so3.log(mirrored.tilts[0]), [-0.1, 0.0, 0.0], atol=1e-12)  # roll
    np.testing.assert_allclose(so3.log(mirrored.tilts[1]), [0.0, 0.2, 0.0], atol=1e-12)  # pitch
    np.testing.assert_array_equal(mirrored.mirrored.images, images)
