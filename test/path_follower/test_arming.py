"""What is held between two commands, and what the operator may ask."""

import pytest

from path_follower.follower import Follower
from path_follower.modes import FollowerState
from path_follower.params import FollowerParams
from path_follower.reasons import StopReason, StopVerdict

SECOND = 1_000_000_000
PARAMS = FollowerParams()


@pytest.fixture
def driving(kit):
    points = kit.course((40, 0))
    follower = Follower(PARAMS, kit.make_path(points[:, :2], PARAMS, points[:, 2]))
    drive = kit.run(follower, (0, 0, 0), seconds=6.0)
    assert drive.commands[-1].speed > 1.0
    return follower, drive.poses[-1], drive.commands[-1].stamp_ns


def test_a_vehicle_that_is_left_alone_is_at_zero_command_and_does_not_ramp_when_it_is_taken_up_again(driving):
    follower, pose, now = driving
    follower.stand(StopVerdict(StopReason.OPERATOR))
    assert follower.update(pose, None, now + SECOND // 20, "TRACKING").speed == 0.0
    assert (follower.mode.state, follower.mode.is_armed) == (FollowerState.STOPPED, False)


def test_after_standing_a_start_goes_on_at_the_place(driving):
    follower, pose, now = driving
    place = follower.location.arc_length
    follower.stand(StopVerdict(StopReason.OPERATOR))
    follower.update(pose, None, now + SECOND // 20, "TRACKING")
    assert follower.start(now + SECOND // 20) == ""
    assert follower.location.arc_length == pytest.approx(place, abs=0.5)
