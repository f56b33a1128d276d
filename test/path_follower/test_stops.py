"""Faults during a drive (F15, F16, F19, F22, F24): the vehicle stops in time, says why, and waits to be armed."""

import itertools
import math

import numpy as np
import pytest

from path_follower.follower import Follower
from path_follower.modes import FollowerState
from path_follower.params import FollowerParams, SafetyParams
from path_follower.reasons import StopReason
from sphere_nav.localization.status import Verdict

SECOND = 1_000_000_000
PARAMS = FollowerParams()
FAULT = 6.0  # s into the drive, at full speed


@pytest.fixture
def straight(kit):
    return kit.course((40, 0))


def standing_after(drive):
    """Seconds from the fault to the first zero command that stays."""
    moving = [command.stamp_ns / 1e9 - 1 for command in drive.commands if command.speed != 0.0]
    return moving[-1] + 0.05 - FAULT


def after_fault(action):
    return lambda now, follower, car: action(now, follower, car) if now >= FAULT else None


def test_a_stop_is_a_ramp_with_wheels_held(kit):
    drive = kit.follow(kit.course((4, 0), (30, 0.2)), each=after_fault(lambda *_: "LOST"))
    ramp = [c for c in drive.commands if c.status.state is FollowerState.STOPPING]
    speeds = [c.speed for c in ramp]
    assert len(speeds) >= 4
    assert all(0.15 < a - b <= 0.2 + 1e-9 for a, b in itertools.pairwise(speeds))  # 4 m/s^2, 50 ms
    assert len({c.steering_angle for c in ramp}) == 1


def test_a_vehicle_that_is_stopped_while_it_accelerates_is_commanded_no_faster(kit, straight):
    """What it gains is dropped at once, at more than the jerk of driving; the brakes are eased in from there."""

    def stop(now, follower, car):
        if now >= 1.0:
            follower.stop()

    follower = Follower(PARAMS, kit.make_path(straight[:, :2], PARAMS))
    drive = kit.run(follower, straight[0], each=stop)
    first = next(k for k, c in enumerate(drive.commands) if c.status.state is FollowerState.STOPPING)
    speeds = np.array([command.speed for command in drive.commands])
    assert 0.3 < speeds[first - 2] < speeds[first - 1] < 1.2  # in the midst of it
    assert np.all(np.diff(speeds[first - 1 :]) <= 0.0)
    assert np.abs(np.diff(speeds[first:], 2)).max() <= PARAMS.vehicle.max_jerk * 0.05**2 + 1e-9
    assert drive.final.verdict.reason is StopReason.OPERATOR


def scan_of(wall_x):
    """A wall across the way, seen in the vehicle's frame."""

    def see(now, follower, car):
        y = np.linspace(-3, 3, 61)
        points = np.stack([np.full(61, wall_x - car.pose.x), y - car.pose.y], axis=-1)
        follower.watch.see_scan(points, round(now * SECOND) + SECOND)

    return see


def test_an_obstacle_stops_the_vehicle_before_it(kit, straight):
    drive = kit.follow(straight, each=scan_of(15.0))
    assert (drive.final.state, drive.final.verdict.reason) == (FollowerState.STOPPED, StopReason.OBSTACLE)
    gap = 15.0 - PARAMS.vehicle.front - drive.poses[-1].x
    assert 0.1 < gap < 2.5


def test_an_emergency_stop_needs_release_and_arming(kit, straight):
    follower = Follower(PARAMS, kit.make_path(straight[:, :2], PARAMS, straight[:, 2]))
    drive = kit.run(follower, (0, 0, 0), each=after_fault(lambda n, f, c: f.emergency(is_pressed=True)))
    kit.assert_within_limits(drive, PARAMS)
    assert (drive.final.state, drive.final.verdict.reason) == (FollowerState.STOPPED, StopReason.EMERGENCY_STOP)
    assert standing_after(drive) <= 0.5
    pose, now = drive.poses[-1], drive.commands[-1].stamp_ns
    assert follower.start(now).startswith("EMERGENCY_STOP")
    follower.emergency(is_pressed=False)
    for _ in range(20):
        now += SECOND // 20
        assert kit.answer(follower, pose, now).speed == 0.0  # released, and it stands
    assert follower.start(now) == ""
    now += SECOND // 20
    assert kit.answer(follower, pose, now).speed > 0.0


def test_recovery_of_the_localizer_alone_moves_nothing_and_a_new_start_goes_on_at_the_place(kit):
    eight = kit.course((2 * math.pi * 5, 0.2), (2 * math.pi * 5, -0.2))
    follower = Follower(PARAMS, kit.make_path(eight[:, :2], PARAMS, eight[:, 2]))
    drive = kit.run(follower, tuple(eight[0]), each=lambda now, *_: "LOST" if 23.0 < now < 30 else "TRACKING")
    progress, pose, now = drive.final.progress, drive.poses[-1], drive.commands[-1].stamp_ns
    assert drive.final.state is FollowerState.STOPPED
    assert progress == pytest.approx(2 * math.pi * 5, abs=2.0)  # near the crossing
    for _ in range(40):
        now += SECOND // 20
        command = kit.answer(follower, pose, now)
        assert (command.speed, command.yaw_rate) == (0.0, 0.0)
    assert follower.start(now) == ""
    assert follower.location.arc_length == pytest.approx(progress, abs=0.6)


@pytest.mark.parametrize(("yaw", "sign"), [(0.0, 1.0), (np.pi, -1.0)], ids=["ahead", "backwards"])
def test_a_clock_that_stands_or_jumps_back_stops(kit, straight, yaw, sign):
    follower = Follower(PARAMS, kit.make_path(straight[:, :2], PARAMS, straight[:, 2] + yaw))
    drive = kit.run(follower, (0, 0, yaw), seconds=6.0)
    assert drive.final.state is FollowerState.DRIVING
    speed, held = drive.commands[-1].speed, [follower.hold(7 * SECOND, pause) for pause in (0.1, 1.0)]
    assert [one.speed for one in held] == pytest.approx([speed - 0.4 * sign, 0.0])
    assert [one.status.state for one in held] == [FollowerState.STOPPING, FollowerState.STOPPED]
    assert {one.status.verdict.reason for one in held} == {StopReason.CLOCK_STOPPED}
    follower.reset()
    assert (follower.mode.state, follower.mode.verdict.reason) == (FollowerState.STOPPING, StopReason.CLOCK_STOPPED)
    speeds = [follower.tick(k * SECOND // 20).speed for k in range(30)]
    assert speeds[0] == drive.commands[-1].speed
    assert speeds[-1] == 0.0
    assert follower.mode.state is FollowerState.STOPPED


def test_a_vehicle_that_is_left_alone_is_at_zero_command_and_does_not_ramp_when_it_is_taken_up_again(kit, straight):
    follower = Follower(PARAMS, kit.make_path(straight[:, :2], PARAMS))
    last = kit.run(follower, (0, 0, 0), seconds=6.0)
    assert last.commands[-1].speed > 1.0
    follower.stand(Verdict(StopReason.OPERATOR))
    assert kit.answer(follower, last.poses[-1], 7 * SECOND + SECOND // 20).speed == 0.0
    assert (follower.mode.state, follower.mode.is_armed) == (FollowerState.STOPPED, False)


@pytest.fixture
def long_way(kit):
    return kit.course((60, 0))


def drive_with_a_gap(kit, long_way, rule, seconds):
    """Drive; for `seconds` from 6 s on no pose is received. A run ends at a stop."""
    params = FollowerParams(safety=SafetyParams(resume=rule))
    follower = Follower(params, kit.make_path(long_way[:, :2], params, long_way[:, 2]))
    accept = follower.watch.see_pose

    def interfere(now, follower, car):
        is_gap = 6.0 <= now < 6.0 + seconds
        follower.watch.see_pose = (lambda *_, **__: None) if is_gap else accept

    drive = kit.run(follower, (0, 0, 0), seconds=20.0, each=interfere)
    follower.watch.see_pose = accept
    return drive, follower


@pytest.mark.parametrize(("rule", "state"), [("never", FollowerState.STOPPED), ("moving", FollowerState.DRIVING)])
def test_poses_that_return_before_standstill_end_the_stop_where_the_rule_says_so(kit, long_way, rule, state):
    drive, follower = drive_with_a_gap(kit, long_way, rule, 0.6)
    assert follower.mode.state is state
    slowest = min(command.speed for command in drive.commands[100:])
    assert (slowest == 0.0) == (rule == "never")


def go_on(kit, follower, pose, now, seconds, state="TRACKING"):
    speeds = []
    for _ in range(round(seconds * 20)):
        now += SECOND // 20
        speeds.append(kit.answer(follower, pose, now, state).speed)
    return speeds


@pytest.mark.parametrize(
    ("rule", "state", "moves"),
    [("standing", "TRACKING", True), ("standing", "DEGRADED", False), ("moving", "TRACKING", False)],
)
def test_standing_for_two_seconds_in_tracking_goes_on_where_the_rule_says_so(kit, long_way, rule, state, moves):
    drive, follower = drive_with_a_gap(kit, long_way, rule, 9.0)
    assert follower.mode.state is FollowerState.STOPPED
    speeds = go_on(kit, follower, drive.poses[-1], drive.commands[-1].stamp_ns, 3.0, state)
    assert max(speeds[:39]) == 0.0  # not before two seconds
    assert (max(speeds) > 0.0) == moves


def test_noise_does_not_add_up_to_progress_while_the_vehicle_stands_paused(kit):
    """Progress only goes forward: of a quarter of a minute of poses with 2 cm of noise it would take the furthest."""
    path = kit.course((8, 0))
    params = FollowerParams()
    follower = Follower(params, kit.make_path(path[:, :2], params, path[:, 2]))
    progress = []

    def interfere(now, follower, car):
        if follower.mode.is_driving and car.pose.x > 7.1 and not progress:
            follower.pause()
        if follower.mode.state is FollowerState.PAUSED and car.speed < 0.001:
            progress.append(follower.location.arc_length)
            if len(progress) == 300:
                follower.resume(round(now * SECOND) + SECOND)

    drive = kit.run(follower, (0, 0, 0), kit.World(position_noise=0.02), seconds=100.0, each=interfere)
    assert len(progress) >= 300
    assert max(progress) - progress[3] < 1e-9  # 0.03 m where each pose counts
    assert drive.final.state is FollowerState.FINISHED
    assert drive.poses[-1].x > 7.93  # a tolerance of 0.05 m, and 0.01 m that it rolls less


def test_a_released_emergency_stop_waits_for_the_call_under_every_rule(kit, long_way):
    params = FollowerParams(safety=SafetyParams(resume="standing"))
    follower = Follower(params, kit.make_path(long_way[:, :2], params, long_way[:, 2]))
    drive = kit.run(follower, (0, 0, 0), seconds=20, each=lambda now, f, car: f.emergency(is_pressed=6 < now < 7))
    follower.emergency(is_pressed=False)
    assert max(go_on(kit, follower, drive.poses[-1], drive.commands[-1].stamp_ns, 5.0)) == 0.0
