"""Whole drives of a bicycle with lags: courses, disturbances, figures of the lateral error.

Bounds: a perfect model leaves millimetres (edges of 0.1 m, steps of 50 ms); what a drive adds is in its comment.
"""

import itertools
import math

import numpy as np
import pytest

from path_follower.modes import FollowerState
from path_follower.params import FollowerParams, VehicleParams
from path_follower.reasons import StopReason

QUARTER = math.pi / 2


@pytest.fixture
def two_turns(kit):
    """About 100 m with two turns of 90 degrees, as in M15 section 6.4.3."""
    return kit.course((35, 0), (QUARTER * 4, 1 / 4), (20, 0), (QUARTER * 4, -1 / 4), (32, 0))


def assert_arrived(drive):
    assert drive.final.state is FollowerState.FINISHED
    assert drive.final.verdict.reason is StopReason.END_OF_PATH
    assert drive.final.distance_to_end < 0.1
    assert drive.commands[-1].speed == 0.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pieces", "bound"),
    [
        (((5, 0), (6, 0.2), (6, -0.2), (6, 0.2), (6, -0.2), (5, 0)), 0.01),
        (((10, 0), (math.pi * 3, 1 / 3), (10, 0)), 0.01),
        (((2 * math.pi * 5, 0.2), (2 * math.pi * 5, -0.2)), 0.01),
        (((8, 0), (4, 0.2), (-6, -0.2), (8, 0.1)), 0.01),
    ],
    ids=["s-curves", "hairpin", "figure eight", "cusps"],
)
def test_a_course_is_driven_to_its_end(kit, pieces, bound):
    drive = kit.follow(kit.course(*pieces))
    assert_arrived(drive)
    assert drive.worst < bound


@pytest.mark.slow
def test_steered_rear_wheels_drive_the_same_curves_and_narrower_ones(kit):
    car = VehicleParams(rear_steering=0.8)  # as the Cycab: 1.2 m steer as 0.67 m
    assert VehicleParams().max_curvature < 0.5 < car.max_curvature
    narrow = kit.course((6, 0), (4, 0.5), (-3, -0.5), (6, 0.3))
    drive = kit.follow(narrow, kit.World(rear_steering=0.8), FollowerParams(vehicle=car))
    assert_arrived(drive)
    assert drive.worst < 0.03  # as tight as it gets: nothing is left to correct with
    unaware = kit.follow(kit.course((5, 0), (6, 0.2), (5, 0)), kit.World(rear_steering=0.8))
    assert unaware.worst < 0.02  # a Twist says yaw rates, not wheels


@pytest.mark.slow
@pytest.mark.parametrize(
    ("world", "rmse", "worst"),
    [
        ({"steering_lag": 0.0, "speed_lag": 0.0}, 0.02, 0.05),  # 0.2 s less
        ({"steering_lag": 0.3, "latency": 0.1, "position_noise": 0.02, "yaw_noise": 0.0087}, 0.02, 0.07),
        ({"steering_bias": math.radians(1)}, 0.035, 0.045),  # 0.0145 1/m over k_y: 18 mm, more with tan(e_psi)
        ({"speed_scale": 0.95}, 0.005, 0.02),
    ],
    ids=str,
)
def test_disturbances_leave_a_few_centimeters(kit, two_turns, world, rmse, worst):
    drive = kit.follow(two_turns, kit.World(**world))
    assert_arrived(drive)
    assert drive.rmse < rmse
    assert drive.worst < worst


def test_an_offset_at_the_start_goes_without_overshoot(kit):
    drive = kit.follow(kit.course((25, 0)), start=(0, 0.5, 0))
    assert_arrived(drive)
    lateral = np.array(drive.lateral)
    assert lateral.min() > -0.03
    assert abs(lateral[-1]) < 0.01
    half = drive.progress[int(np.argmax(lateral < 0.25))]
    assert half < 4.0  # 1.9 m by the poles, and the wheels turn at a bounded rate


def test_the_vehicle_stands_still_between_directions(kit):
    drive = kit.follow(kit.course((6, 0), (-4, 0.2), (5, -0.2)))
    assert_arrived(drive)
    signs = np.sign([command.speed for command in drive.commands])
    changes = [(a, b) for a, b in itertools.pairwise(signs) if a != b]
    assert changes == [(0, 1), (1, 0), (0, -1), (-1, 0), (0, 1), (1, 0)]
    assert_cusps_are_reached(drive)


def assert_cusps_are_reached(drive):
    x = [pose.x for pose in drive.poses]
    assert max(x[: len(x) // 2]) == pytest.approx(6.0, abs=0.12)  # tolerance, and what rolls on


CORNER = np.array([[0, 0], [10, 0], [10, 10.0]])


def test_a_corner_that_no_car_can_turn_ends_in_a_stop_and_not_in_a_field(kit):
    drive = kit.follow(CORNER, start=(0, 0, 0))
    assert drive.final.state is FollowerState.STOPPED
    assert drive.final.verdict.reason is StopReason.OFF_PATH
