"""Which stops end by themselves, by the rule `safety.resume`."""

import pytest

from path_follower.follower import Follower
from path_follower.modes import FollowerState
from path_follower.params import FollowerParams, SafetyParams

SECOND = 1_000_000_000


@pytest.fixture
def straight(kit):
    return kit.course((60, 0))


def drive_with_a_gap(kit, straight, rule, seconds):
    """Drive; for `seconds` from 6 s on no pose is received. A run ends at a stop."""
    params = FollowerParams(safety=SafetyParams(resume=rule))
    follower = Follower(params, kit.make_path(straight[:, :2], params, straight[:, 2]))
    accept = follower.watch.see_pose

    def interfere(now, follower, car):
        is_gap = 6.0 <= now < 6.0 + seconds
        follower.watch.see_pose = (lambda *_: False) if is_gap else accept

    drive = kit.run(follower, (0, 0, 0), seconds=20.0, each=interfere)
    follower.watch.see_pose = accept
    return drive, follower


@pytest.mark.parametrize(("rule", "state"), [("never", FollowerState.STOPPED), ("moving", FollowerState.DRIVING)])
def test_poses_that_return_before_standstill_end_the_stop_where_the_rule_says_so(kit, straight, rule, state):
    drive, follower = drive_with_a_gap(kit, straight, rule, 0.6)
    assert follower.mode.state is state
    slowest = min(command.speed for command in drive.commands[100:])
    assert (slowest == 0.0) == (rule == "never")


def test_a_vehicle_that_stands_waits_for_the_call(kit, straight):
    drive, _ = drive_with_a_gap(kit, straight, "moving", 2.0)
    assert drive.final.state is FollowerState.STOPPED


def go_on(follower, pose, now, seconds, state="TRACKING"):
    speeds = []
    for _ in range(round(seconds * 20)):
        now += SECOND // 20
        speeds.append(follower.update(pose, None, now, state).speed)
    return speeds


@pytest.mark.parametrize(
    ("rule", "state", "moves"),
    [("standing", "TRACKING", True), ("standing", "DEGRADED", False), ("moving", "TRACKING", False)],
)
def test_standing_for_two_seconds_in_tracking_goes_on_where_the_rule_says_so(kit, straight, rule, state, moves):
    drive, follower = drive_with_a_gap(kit, straight, rule, 9.0)
    assert follower.mode.state is FollowerState.STOPPED
    speeds = go_on(follower, drive.poses[-1], drive.commands[-1].stamp_ns, 3.0, state)
    assert max(speeds[:39]) == 0.0  # not before two seconds
    assert (max(speeds) > 0.0) == moves


def test_what_was_wrong_waits_for_the_call_under_every_rule(kit, straight):
    params = FollowerParams(safety=SafetyParams(resume="standing"))
    follower = Follower(params, kit.make_path(straight[:, :2], params, straight[:, 2]))
    drive = kit.run(follower, (0, 0, 0), seconds=20, each=lambda now, f, car: f.emergency(is_pressed=6 < now < 7))
    follower.emergency(is_pressed=False)
    assert max(go_on(follower, drive.poses[-1], drive.commands[-1].stamp_ns, 5.0)) == 0.0


@pytest.mark.slow
def test_noise_does_not_add_up_to_progress_while_the_vehicle_stands_paused(kit):
    """Progress only goes forward: of a minute of poses with 2 cm of noise it would take the furthest."""
    path = kit.course((8, 0))
    params = FollowerParams()
    follower = Follower(params, kit.make_path(path[:, :2], params, path[:, 2]))
    progress = []

    def interfere(now, follower, car):
        if follower.mode.is_driving and car.pose.x > 7.1 and not progress:
            follower.pause()
        if follower.mode.state is FollowerState.PAUSED and car.speed < 0.001:
            progress.append(follower.location.arc_length)
            if len(progress) == 1200:
                follower.resume(round(now * SECOND) + SECOND)

    drive = kit.run(follower, (0, 0, 0), kit.World(position_noise=0.02), seconds=100.0, each=interfere)
    assert len(progress) >= 1200
    assert max(progress) - progress[3] < 1e-9  # 0.03 m where each pose counts
    assert drive.final.state is FollowerState.FINISHED
    assert drive.poses[-1].x > 7.93  # a tolerance of 0.05 m, and 0.01 m that it rolls less
