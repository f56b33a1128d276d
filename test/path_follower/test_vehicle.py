"""The car: exact arcs, limits that nothing passes, and a model that knows where the commands lead."""

import math
import time

import numpy as np
import pytest

from path_follower.params import ActuationParams, VehicleParams
from path_follower.path import Pose2
from path_follower.vehicle import Limiter, Motion, Predictor, drive

CAR = VehicleParams(max_acceleration=0.7, max_deceleration=1.1, max_jerk=1e9)  # unequal: exchanged ones are noticed
STEP = 50_000_000


def test_an_arc_is_exact_and_composes():
    start, motion = Pose2(1, 2, 0.3), Motion(1.5, 0.3)
    once = drive(start, motion, CAR.wheelbase, 2.0)
    twice = drive(drive(start, motion, CAR.wheelbase, 0.7), motion, CAR.wheelbase, 1.3)
    np.testing.assert_allclose(once, twice, atol=1e-12)
    radius = CAR.wheelbase / math.tan(0.3)
    center = np.array([1 - radius * math.sin(0.3), 2 + radius * math.cos(0.3)])
    assert np.hypot(*(np.array(once[:2]) - center)) == pytest.approx(radius)


def test_nothing_passes_a_limit_whatever_is_asked():
    rng = np.random.default_rng(0)
    limiter, last, now = Limiter(CAR), Motion(0.0, 0.0), 0
    for _ in range(2000):
        now += int(rng.integers(1, 3 * STEP))
        wild = [*(rng.normal(size=2) * 10.0 ** rng.integers(-2, 4)), math.nan, math.inf, -math.inf]
        is_hard = bool(rng.integers(2))
        seconds = (now - (limiter.last_ns if limiter.last_ns is not None else now)) / 1e9
        speed, curvature = (wild[i] for i in rng.choice(5, 2, p=[0.4, 0.4, 0.06, 0.07, 0.07]))
        motion = limiter.limit(speed, curvature, now, is_hard=is_hard)
        seconds = min(seconds, 0.2)
        braking = CAR.stop_deceleration if is_hard else CAR.max_deceleration
        assert math.isfinite(motion.speed)
        assert abs(motion.speed) <= CAR.max_speed
        assert abs(motion.steering_angle) <= CAR.max_steering_angle
        assert abs(motion.speed) - abs(last.speed) <= CAR.max_acceleration * seconds + 1e-9
        assert abs(last.speed) - abs(motion.speed) <= braking * seconds + 1e-9
        assert abs(motion.steering_angle - last.steering_angle) <= CAR.max_steering_rate * seconds + 1e-9
        assert motion.speed * last.speed >= 0
        if motion.speed == 0.0:
            assert motion.steering_angle == last.steering_angle
            assert motion.yaw_rate(CAR.wheelbase) == 0.0
        last = motion


@pytest.mark.parametrize("step", [STEP, 37_000_000, 25_000_000])
def test_a_speed_is_eased_into_and_out_of(step):
    car = VehicleParams(max_acceleration=0.7, max_deceleration=1.1, max_jerk=2.0)
    limiter, speeds, seconds = Limiter(car), [0.0], step / 1e9
    goals = [goal for goal, lasts in ((1.5, 5), (0.4, 3), (-0.6, 5), (0.0, 3)) for _ in range(round(lasts / seconds))]
    for k, goal in enumerate(goals):
        speeds.append(limiter.limit(goal, 0.0, k * step, is_hard=False).speed)
        assert abs(speeds[-1]) <= 1.5 + 1e-9
    for end, goal in ((5, 1.5), (8, 0.4), (13, -0.6), (16, 0.0)):
        assert speeds[round(end / seconds)] == pytest.approx(goal, abs=1e-4)
    gain = np.diff(np.abs(speeds[1:])) / seconds
    assert gain.max() == pytest.approx(0.7, abs=0.01)
    assert gain.min() == pytest.approx(-1.1, abs=0.06)
    jerk = np.diff(speeds[1:], 2) / seconds**2
    assert np.abs(jerk).max() <= 2.0 + 1e-6
    assert np.abs(jerk).max() > 1.9
    reached = np.argmax(np.array(speeds) > 1.49) * seconds  # 1.5 / 0.7 + 0.7 / 2 seconds at best
    assert reached == pytest.approx(1.5 / 0.7 + 0.35, abs=0.2)


@pytest.mark.parametrize("age_ns", [0, 100_000_000, 170_000_000])
def test_a_car_is_predicted_where_it_will_be(age_ns):
    actuation = ActuationParams(dead_time=0.08, steering_lag=0.3, speed_lag=0.2)
    predictor, horizon = Predictor(CAR, actuation), round((0.08 + 0.3) * 1e9)
    commands = {k * STEP: Motion(1.0 + 0.3 * math.sin(k / 9), 0.3 * math.sin(k / 7)) for k in range(100)}
    fine = 1_000_000
    truth, pose, speed, angle = {}, Pose2(0, 0, 0), 0.0, 0.0
    for now in range(0, 95 * STEP + horizon, fine):
        truth[now] = pose
        due = [command for given, command in commands.items() if given <= min(now - 80_000_000, 94 * STEP)]
        command = due[-1] if due else Motion(0, 0)
        speed += (command.speed - speed) * fine / 1e9 / 0.2
        angle += (command.steering_angle - angle) * fine / 1e9 / 0.3
        pose = drive(pose, Motion(speed, angle), CAR.wheelbase, fine / 1e9)
    now = 94 * STEP
    for given, command in commands.items():
        if given <= now:
            predictor.remember(given, command)
    found = predictor.predict(truth[now - age_ns], now - age_ns, now, None)
    expected = truth[now + horizon - horizon % fine]
    assert math.hypot(found.x - expected.x, found.y - expected.y) < 0.01  # steps of 20 ms against 1 ms
    assert abs(found.yaw - expected.yaw) < 0.01


def test_a_measured_speed_overrules_the_model_and_leaves_the_wheels_turned():
    predictor = Predictor(CAR, ActuationParams(steering_lag=0.2, speed_lag=2.0))
    for k in range(100):
        predictor.remember(k * STEP, Motion(0.2, 0.3))
    moved = predictor.predict(Pose2(0, 0, 0), 99 * STEP, 99 * STEP, 1.5)
    assert moved.x == pytest.approx(0.3, abs=0.03)  # the model lets it lose a tenth on the way
    assert moved.yaw == pytest.approx(0.3 * math.tan(0.3) / CAR.wheelbase, rel=0.1)


def test_a_clock_that_leaps_by_years_takes_no_time():
    predictor = Predictor(CAR, ActuationParams())
    predictor.remember(0, Motion(2.0, 0.1))
    began = time.process_time()
    predictor.remember(2**31 * 10**9, Motion(1.0, 0.0))
    assert predictor.motion.speed == pytest.approx(2.0)
    moved = predictor.predict(Pose2(0, 0, 0), 2**31 * 10**9 - STEP, 2**31 * 10**9, None)
    assert 0.05 < moved.x < 1.0
    assert time.process_time() - began < 5.0


def test_a_car_stands_below_three_centimeters_a_second():
    predictor = Predictor(CAR, ActuationParams())
    for speed, is_standing in ((0.02, True), (0.04, False), (-0.02, True), (-0.04, False)):
        predictor.history.append((0, Motion(0.0, 0.0), Motion(speed, 0.0)))
        assert predictor.is_standing == is_standing


def test_a_start_waits_once_until_the_wheels_are_turned_within_a_tenth():
    for off, waits in [(0.09, False), (0.11, True), (-0.09, False), (-0.11, True)]:
        limiter = Limiter(CAR)
        limiter.last = Motion(0.0, 0.2 + off)
        assert limiter.is_starting(math.tan(0.2) / CAR.wheelbase) == waits
    limiter = Limiter(CAR)
    assert limiter.is_starting(0.3)
    for k in range(60):
        limiter.limit(0.1, 0.3, k * STEP, is_hard=False)
    assert not limiter.is_starting(0.3)
    assert not limiter.is_starting(-0.3)  # under way


def test_a_pose_is_predicted_over_half_a_second_and_commands_are_kept_for_ten():
    predictor = Predictor(CAR, ActuationParams(steering_lag=0.0, speed_lag=0.0))
    for k in range(201):
        predictor.remember(2 * k * STEP, Motion(1.0, 0.0))
    now = 400 * STEP
    assert predictor.predict(Pose2(0, 0, 0), now - 8 * STEP, now, None).x == pytest.approx(0.4)
    assert predictor.predict(Pose2(0, 0, 0), now - 40 * STEP, now, None).x == pytest.approx(0.5)
    assert now - predictor.history[0][0] == pytest.approx(10.0e9, abs=2 * STEP)


def test_a_stop_uses_the_deceleration_that_it_may_and_a_start_the_acceleration():
    for is_hard, loss, gain in [(False, 1.1, 0.7), (True, 4.0, 0.0)]:
        limiter = Limiter(CAR)
        limiter.limit(0.0, 0.0, 0, is_hard=False)
        limiter.last = Motion(-1.5, 0.0)
        assert limiter.limit(0.0, 0.0, STEP, is_hard=is_hard).speed == pytest.approx(-1.5 + loss * 0.05)
        limiter.last = Motion(0.5, 0.0)
        assert limiter.limit(2.0, 0.0, 2 * STEP, is_hard=is_hard).speed == pytest.approx(0.5 + gain * 0.05)


def test_how_the_time_is_cut_up_changes_no_speed():
    """In lock step a slow process is told of time in other pieces; goals change at 0, 0.4 and 1.6 s."""
    car = VehicleParams(max_acceleration=0.7, max_deceleration=1.1, max_jerk=2.0)
    rng, found = np.random.default_rng(4), []
    for count in (3, 20, 200):
        limiter, last = Limiter(car), 0
        limiter.limit(0.0, 0.0, 0, is_hard=False)
        speeds = []
        for until, goal in ((400, 1.5), (1600, 0.3), (3600, 1.2)):
            cuts = np.unique([*range(last + 50, until, 50), *rng.integers(last + 1, until, count), until])
            for now in cuts:
                speed = limiter.limit(goal, 0.0, int(now) * 1_000_000, is_hard=False).speed
                if now % 50 == 0:
                    speeds.append(speed)
            last = until
        found.append(speeds)
    np.testing.assert_allclose(found[1:], [found[0]] * 2, rtol=0, atol=1e-12)
    assert found[0][-1] == pytest.approx(1.2)


def test_a_prediction_goes_by_steps_of_20_ms():
    predictor = Predictor(CAR, ActuationParams(steering_lag=0.0, speed_lag=0.5))
    predictor.remember(0, Motion(1.0, 0.0))
    predicted = predictor.predict(Pose2(0, 0, 0), 0, 8 * STEP, None).x
    assert predicted == pytest.approx(sum(0.02 * (1.0 - math.exp(-0.02 * k / 0.5)) for k in range(1, 21)))
