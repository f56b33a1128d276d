"""Poses against odometry and commands: each fault by its name, what is none, and the rate of false alarms."""

import math

import numpy as np
import pytest

from path_follower.consistency import MotionConsistency, judge_covariance
from path_follower.follower import Follower
from path_follower.modes import FollowerState
from path_follower.params import FollowerParams, SafetyParams
from path_follower.path import Pose2, between
from path_follower.reasons import FINE, StopReason
from path_follower.vehicle import ORIGIN, Motion, Predictor, drive
from sphere_nav.geometry import SE3

SECOND, STEP = 1_000_000_000, 100_000_000
PARAMS = FollowerParams()
NOISE = (0.02, 0.02, 0.0087)
STATED = np.diag(np.square(NOISE))


def compose_poses(a, b):
    return Pose2.of(SE3.from_planar(*a) @ SE3.from_planar(*b))


class Car:
    """Drives a bend at 1.4 m/s as commanded; gives a pose and 5 messages of odometry each tenth of a second."""

    def __init__(self, params=PARAMS, motion=None, has_odometry=False, seed=0):
        self.motion = motion or Motion(1.4, 0.1)
        self.predictor = Predictor(params.vehicle, params.actuation)
        self.consistency = MotionConsistency(params, self.predictor)
        self.rng, self.has_odometry = np.random.default_rng(seed), has_odometry
        self.now, self.true, self.driven, self.age = SECOND, Pose2(3.0, -2.0, 2.5), Pose2(7.0, 7.0, -1.0), 0.0
        self.share, self.wheels_stand, self.slip = 1.0, False, 0.0  # share: of the commanded way that it drives
        self.told = self.driven, self.motion.speed
        self.predictor.remember(self.now, self.motion)

    def step(self, fault=lambda pose, age: pose, covariance=STATED, is_driving=True):
        """Let a tenth of a second pass; return what speaks against the pose after it."""
        self.move()
        pose = compose_poses(self.true, Pose2(*self.rng.normal(size=3) * NOISE))
        return self.consistency.see_pose(fault(pose, self.age), covariance, self.now, is_driving=is_driving)

    def move(self):
        for _ in range(5):
            way = self.predictor.travel(self.now, self.now + STEP // 5)[0]
            self.now += STEP // 5
            self.predictor.remember(self.now, self.motion)
            way = Pose2(*(self.share * np.array(way)))
            turned = Pose2((1.0 + self.slip) * way.x, (1.0 + self.slip) * way.y, way.yaw)
            self.true, self.driven = compose_poses(self.true, way), compose_poses(self.driven, turned)
            if not self.wheels_stand:
                self.told = self.driven, self.share * self.motion.speed
            if self.has_odometry:
                self.consistency.see_odometry(*self.told, self.motion.yaw_rate(1.2), self.now)

    def suffer(self, fault=lambda pose, age: pose, seconds=12.0, **values):
        """Drive 5 s, then with the fault; return the first reason to stop and the seconds until then."""
        for _ in range(50):
            doubt = self.step()
            assert (doubt.stop, doubt.slow) == (FINE, FINE)
        for _ in range(round(seconds * 10)):
            self.age += 0.1
            doubt = self.step(fault, **values)
            if doubt.stop is not FINE:
                return doubt.stop.reason, self.age
        return None, math.inf


def frozen():
    kept = []

    def fault(pose, age):
        kept.append(pose)
        return kept[0]

    return fault


def beside(x, y, yaw):
    return lambda pose, age: compose_poses(pose, Pose2(x, y, yaw))


def drift(along, aside):
    return lambda pose, age: compose_poses(pose, Pose2(along * age, aside * age, 0))


@pytest.mark.parametrize(("has_odometry", "sign", "speed"), [(False, 1.0, 1.4), (True, -1.0, -1.0), (False, -1.0, 0.5)])
def test_a_frozen_jumping_or_turning_pose_is_named_within_meters(has_odometry, sign, speed):
    def suffer(fault):
        return Car(motion=Motion(speed, -0.1 * sign), has_odometry=has_odometry).suffer(fault)

    reason, seconds = suffer(frozen())
    assert (reason, abs(speed) * seconds < 0.9) == (StopReason.POSE_FROZEN, True)
    for jump in ((0.9 * sign, 0, 0), (0, 0.9 * sign, 0), (0, 0, 0.9 * sign)):
        assert suffer(beside(*jump)) == (StopReason.POSE_JUMP, 0.1)
    reason, seconds = suffer(lambda pose, age: compose_poses(pose, Pose2(0, 0, 0.2 * sign * age)))
    assert (reason, seconds < 2.6) == (StopReason.POSE_INCONSISTENT, True)
    reason, seconds = suffer(lambda pose, age: compose_poses(pose, Pose2(0, 0.5 * sign * age, 0)))
    assert (reason, seconds < 2.6) == (StopReason.POSE_INCONSISTENT, True)
    reason, seconds = suffer(lambda pose, age: compose_poses(pose, Pose2(0, 0, sign * min(0.03 * age, 0.6))))
    assert (reason, seconds < 12.0) == (StopReason.POSE_INCONSISTENT, True) or abs(speed) < 1.0  # 4 m take 8 s


@pytest.mark.parametrize(("sign", "has_odometry"), [(1.0, False), (-1.0, True)])
def test_a_heading_wrong_from_the_start_shows_in_the_direction_of_motion(sign, has_odometry):
    car, wrong = Car(has_odometry=has_odometry), beside(0, 0, 0.9 * sign)
    found = [car.step(wrong, is_driving=k > 0).stop.reason for k in range(20)]
    first = next(k for k, reason in enumerate(found) if reason is not StopReason.NONE)
    assert (found[first], first * 0.14 < 1.0) == (StopReason.POSE_INCONSISTENT, True)


@pytest.mark.parametrize("has_odometry", [False, True])
def test_a_vehicle_that_does_not_move_is_not_a_frozen_pose(has_odometry):
    car = Car(has_odometry=has_odometry)
    for _ in range(50):
        car.step()
    car.share = 0.0
    assert next(filter(None, (car.step().stop.reason for _ in range(20)))) is StopReason.NOT_MOVING
    if has_odometry:  # also where the pose repeats itself to the last digit
        car, fault = Car(has_odometry=True), frozen()
        for _ in range(50):
            car.step()
        car.share = 0.0
        assert next(filter(None, (car.step(fault).stop.reason for _ in range(20)))) is StopReason.NOT_MOVING


@pytest.mark.parametrize(("sign", "speed"), [(1.0, 2.0), (-1.0, 1.4), (1.0, -1.0)])
def test_with_wheels_a_slow_drift_is_noticed_before_the_pose_is_far_off(sign, speed):
    """Aside by 0.1 m/s within 0.5 m, behind by 0.2 m/s within 1 m; at 2 m/s the share of the way is small."""
    for along, aside, limit in ((0.0, 0.1 * sign, 0.5), (0.2 * sign, 0.0, 1.0)):
        car = Car(motion=Motion(speed, 0.1), has_odometry=True)
        reason, seconds = car.suffer(drift(along, aside))
        assert reason is StopReason.POSE_INCONSISTENT
        assert math.hypot(along, aside) * seconds <= (1.25 if speed == 2.0 else 1.0) * limit


@pytest.mark.parametrize("axis", range(3), ids=["along", "across", "yaw"])
@pytest.mark.parametrize("has_odometry", [False, True])
def test_only_what_dead_reckoning_cannot_be_wrong_by_adds_up(has_odometry, axis):
    """0.04 a step, while the vehicle slows down and its bend opens: shares of the way and turn, and 0.15 or 0.03 s."""
    car = Car(motion=Motion(1.0, 0.3), has_odometry=has_odometry)
    for _ in range(30):
        car.move()
    pose = car.true
    car.consistency.see_pose(pose, STATED, car.now, is_driving=True)
    car.motion, way, turn = Motion(0.5, 0.1), 0.0, 0.0
    for _ in range(40):
        before = car.true
        car.move()
        step = between(before, car.true)
        way, turn = way + math.hypot(step.x, step.y), turn + step.yaw
        pose = compose_poses(pose, Pose2(*(np.array(step) + 0.04 * (np.arange(3) == axis))))
        car.consistency.see_pose(pose, STATED, car.now, is_driving=True)
    along, across, a_meter, a_turn, seconds = (
        (0.07, 0.03, 0.02, 0.1, 0.03) if has_odometry else (0.2, 0.06, 0.03, 0.1, 0.15)
    )
    slower = Motion(1.0, 0.3).yaw_rate(1.2) - Motion(0.5, 0.1).yaw_rate(1.2)
    allowed = (along * way + seconds * 0.5, across * way, a_meter * way + a_turn * turn + seconds * slower)
    assert car.consistency._pose.share == pytest.approx((1.6 - allowed[axis]) / (0.25, 0.25, 0.12)[axis], rel=0.01)


@pytest.mark.parametrize("slip", [0.06, -0.06])
def test_wheels_of_another_radius_are_no_fault_of_the_pose(slip):
    car = Car(has_odometry=True)
    car.slip = slip
    assert car.suffer(seconds=60.0) == (None, math.inf)


def test_wheels_that_stand_while_the_pose_moves_stop():
    car = Car(has_odometry=True)
    assert car.suffer(seconds=1.0) == (None, math.inf)
    car.wheels_stand = True  # the last message again and again, with new stamps
    found = [car.step().stop for _ in range(5)]
    first = next(k for k, stop in enumerate(found) if stop is not FINE)
    assert (found[first].reason, first < 4) == (StopReason.POSE_INCONSISTENT, True)


@pytest.mark.parametrize("is_driving", [False, True])
def test_wheels_that_were_heard_and_are_silent_stop(is_driving):
    car = Car(has_odometry=True)
    car.step(is_driving=is_driving)
    car.has_odometry = False
    found = [car.step(is_driving=is_driving).stop for _ in range(5)]
    assert [stop.reason for stop in found] == 4 * [StopReason.NONE] + [StopReason.ODOM_TIMEOUT]
    assert (found[-1].value, found[-1].limit) == pytest.approx((0.5, 0.4))
    car.has_odometry = True
    assert car.step(is_driving=is_driving).stop is FINE


@pytest.mark.parametrize("deviation", [0.1, 0.02])
def test_a_small_correction_does_not_stop_and_slows_down_only_where_its_covariance_does_not_explain_it(deviation):
    car = Car()
    stated = np.diag(np.square([deviation, deviation, 0.02]))
    doubts = [car.step(beside(0.1, 0.15, 0.03) if k > 25 else beside(0, 0, 0), stated) for k in range(80)]
    assert {doubt.stop for doubt in doubts} == {FINE}
    slow = [k for k, doubt in enumerate(doubts) if doubt.slow is not FINE]
    assert bool(slow) == (deviation < 0.1)
    if slow:  # while the windows reach back to it, and two seconds more
        assert 26 <= slow[0] < slow[-1] < 26 + 20 + 32
        assert doubts[slow[0]].slow.reason is StopReason.POSE_INCONSISTENT


@pytest.mark.parametrize("late_s", [0.0, 0.1], ids=["between messages", "after the last"])
def test_poses_between_or_after_messages_of_odometry_are_no_fault_of_the_pose(late_s):
    """In a bend of 0.7 m radius, at any time since the last message, and without noise."""
    predictor = Predictor(PARAMS.vehicle, PARAMS.actuation)
    consistency, motion = MotionConsistency(PARAMS, predictor), Motion(1.0, 1.05)
    shares, begin = [], Pose2(7.0, 7.0, -1.0)

    def at(seconds):
        return compose_poses(begin, drive(ORIGIN, motion, 1.2, seconds))

    predictor.remember(SECOND, motion)
    times = np.cumsum(np.tile([0.07, 0.03, 0.05, 0.09, 0.06], 8))
    for seconds in times:
        for number in range(100):
            when = 0.1 * number
            if when <= seconds + (0.1 if late_s == 0.0 else 0.0):
                consistency.see_odometry(at(when), 1.0, motion.yaw_rate(1.2), SECOND + round(when * SECOND))
        consistency.see_pose(at(seconds), 1e-8 * np.eye(3), SECOND + round(seconds * SECOND), is_driving=True)
        shares.append(consistency._pose.share)
    assert max(shares) < 0.02


def test_a_jump_while_nobody_drives_or_after_a_long_gap_is_none():
    car = Car()
    assert car.step(is_driving=False).stop is FINE
    assert car.step(beside(5.0, 0, 2.0), is_driving=False).stop is FINE
    assert car.step(beside(5.0, 0, 2.0)).stop is FINE
    for seconds, reason in ((2.4, StopReason.POSE_JUMP), (2.6, StopReason.NONE)):
        car = Car()
        assert car.suffer(seconds=1.0) == (None, math.inf)
        then = car.now + round(seconds * SECOND)
        assert car.consistency.see_pose(Pose2(50.0, 0.0, 0.0), STATED, then, is_driving=True).stop.reason is reason


def test_an_uncertain_pose_stops_though_the_check_of_motion_is_off():
    car = Car(FollowerParams(safety=SafetyParams(is_motion_checked=False)))
    assert car.suffer(beside(0.9, 0, 0.9), seconds=1.0) == (None, math.inf)
    assert car.step(covariance=1e6 * np.eye(3)).stop.reason is StopReason.POSE_UNCERTAIN


def test_a_standard_deviation_slows_above_the_limit_and_stops_above_twice_that_in_its_worst_direction():
    for scale in [0.999, 1.001, 1.999, 2.001]:
        for axis, limit in [(0, 0.5), (1, 0.5), (2, 0.25)]:
            covariance = np.diag([1e-4, 1e-4, 1e-4])
            covariance[axis, axis] = (scale * limit) ** 2
            doubt = judge_covariance(covariance, PARAMS.safety)
            assert (doubt.slow is not FINE, doubt.stop is not FINE) == (scale > 1.0, scale > 2.0)
            assert {v.reason for v in (doubt.slow, doubt.stop) if v is not FINE} <= {StopReason.POSE_UNCERTAIN}
            if scale > 2.0:
                assert (doubt.stop.value, doubt.stop.limit) == pytest.approx((scale * limit, 2.0 * limit))
    turned = np.array([[0.3, 0.25, 0.0], [0.25, 0.3, 0.0], [0.0, 0.0, 1e-4]])  # 0.74 m along the diagonal
    assert judge_covariance(turned, PARAMS.safety).slow.value == pytest.approx(math.sqrt(0.55))
    for wrong in (np.full((3, 3), np.nan), np.diag([1e-4, -1e-4, 1e-4]), turned + np.diag([-0.29, 0, 0])):
        assert judge_covariance(wrong, PARAMS.safety).stop.reason is StopReason.POSE_UNCERTAIN
    for zeros in (np.zeros((3, 3)), np.diag([1e-4, 1e-4, 0.0])):
        stop = judge_covariance(zeros, PARAMS.safety).stop
        assert (stop.reason, "found zeros" in stop.detail) == (StopReason.POSE_UNCERTAIN, True)


# --- in the follower
def make_follower(kit):
    follower = Follower(PARAMS, kit.make_path([(0, 0), (200, 0)], PARAMS))
    follower.watch.see_status("TRACKING", SECOND)
    return follower


def test_an_uncertain_pose_does_not_start_and_a_doubtful_one_drives_slowly_for_a_limited_time(kit):
    follower, now = make_follower(kit), SECOND
    follower.see_pose(SE3.from_planar(1, 0, 0), now, None, np.diag([1e6, 1e6, 1e-4]))
    assert follower.start(now).startswith("POSE_UNCERTAIN: standard deviation 1e+03 m, limit 1:")
    x, verdicts, limit = 1.0, [], 10.0
    for k in range(1, round(10 * limit) + 25):
        now += STEP
        follower.watch.see_status("TRACKING", now)
        follower.see_pose(SE3.from_planar(x, 0, 0), now, None, np.diag([0.49, 0.49, 1e-4]))
        if k == 1:
            assert follower.start(now) == ""
        command = follower.tick(now)
        x += command.speed * 0.1
        verdicts.append((command.status.state, command.status.verdict.reason))
        assert command.speed <= PARAMS.speed.slow + 1e-9
    assert verdicts[50] == (FollowerState.SLOW, StopReason.POSE_UNCERTAIN)
    assert verdicts[-1] == (FollowerState.STOPPED, StopReason.POSE_UNCERTAIN)
    first = next(k for k, (state, _) in enumerate(verdicts) if state is not FollowerState.SLOW)
    assert first == pytest.approx(10 * limit, abs=2)


def test_a_localizer_of_another_map_is_refused_and_one_that_changes_it_stops(kit):
    follower = make_follower(kit)
    object.__setattr__(follower.path, "map_id", "yard")
    follower.see_pose(SE3.from_planar(1, 0, 0), SECOND)
    for map_id, answer in (
        ("street", "WRONG_MAP: the path is of map yard, the pose of street"),
        ("", ""),
        ("yard", ""),
    ):
        follower.watch.see_status("TRACKING", SECOND, map_id=map_id)
        assert follower.start(SECOND).startswith(answer)
        assert bool(follower.start(SECOND)) == bool(answer)
        assert follower.tick(SECOND).status.is_armed == (not answer)
    follower.watch.see_status("TRACKING", SECOND, map_id="street")
    assert follower.tick(SECOND).status.verdict.reason is StopReason.WRONG_MAP


# --- rates
@pytest.mark.slow
@pytest.mark.parametrize(("has_odometry", "deviation"), [(False, 0.05), (True, 0.2)])
def test_noise_that_poses_state_raises_no_alarm_and_twice_as_much_does(has_odometry, deviation):
    """A tenth lost, a wheel that turns to and fro; what is allowed grows with what is stated, not with the time."""
    stated, largest = np.diag(np.square([deviation, deviation, 0.4 * deviation])), {}
    for factor in (1.0, 2.0):
        shares = []
        for seed in range(4):
            car = Car(seed=seed, has_odometry=has_odometry)
            for k in range(300):
                car.motion = Motion(1.4 if k % 100 > 20 else 0.7, 0.2 * math.sin(k / 20))
                if car.rng.random() < 0.1:
                    car.move()
                    continue
                noise = Pose2(*(factor * car.rng.normal(size=3) * np.sqrt(np.diagonal(stated))))
                doubt = car.step(lambda pose, age, car=car, noise=noise: compose_poses(car.true, noise), stated)
                shares.append(car.consistency._pose.share)
                assert factor > 1.0 or (doubt.stop, doubt.slow) == (FINE, FINE)
        largest[factor] = max(shares)
    assert largest[1.0] < 0.75
    assert largest[2.0] > 1.0 or deviation < 0.03  # less than 0.25 m does not stop, however sure


@pytest.mark.parametrize(("noise", "stops"), [(0.01, True), (0.06, False)])
def test_poses_that_scatter_less_than_they_state_are_held_to_what_they_do(noise, stops, monkeypatch):
    """What all of them share of the map's errors makes no step; what really scatters is allowed as it is stated."""
    monkeypatch.setattr(f"{__name__}.NOISE", (noise, noise, 0.005))
    car, stated = Car(has_odometry=True), np.diag(np.square([0.06, 0.06, 0.01]))
    reasons = [car.step(drift(0, 0), covariance=stated).stop.reason for _ in range(50)]
    assert set(reasons) == {StopReason.NONE}
    for _ in range(60):
        car.age += 0.1
        reasons.append(car.step(drift(0.0, 0.1), covariance=stated).stop.reason)
    assert (StopReason.POSE_INCONSISTENT in reasons) == stops
