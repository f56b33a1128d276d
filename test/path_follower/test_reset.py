"""The law of all that keeps what has a stamp: after a jump of the clock it is as a new one."""

from collections import deque
from dataclasses import fields, is_dataclass

import numpy as np

from path_follower.follower import Follower
from path_follower.params import FollowerParams
from path_follower.path import Pose2
from path_follower.ros.intake import Answered
from sphere_nav.ros.clocks import Times

SECOND = 10**9
PARAMS = FollowerParams()
KEPT = {"params", "_params", "vehicle", "actuation", "is_emergency", "outside"}  # of the operator, or of no time


def state_of(item, seen=()):
    """Return what an object holds, as plain values."""
    if isinstance(item, np.ndarray):
        return item.tolist()
    if isinstance(item, tuple | list | deque):
        return [state_of(one, seen) for one in item]
    if is_dataclass(item):
        return {field.name: state_of(getattr(item, field.name), seen) for field in fields(item)}
    if not hasattr(item, "__dict__") or callable(item) or id(item) in seen:
        return item if not callable(item) else None
    seen = (*seen, id(item))
    return {name: state_of(value, seen) for name, value in vars(item).items() if name not in KEPT}


def soil(follower):
    """Give it all that it may be given."""
    watch = follower.watch
    for step in range(1, 30):
        now = SECOND + step * SECOND // 20
        follower.consistency.see_odometry(Pose2(0.05 * step, 0.0, 0.0), 1.0, 0.1, now)
        follower.see_pose(Pose2(0.05 * step, 0.3 * (step > 20), 0.0), now, 1.0, np.diag([0.49, 0.49, 1e-4]))
        watch.see_status("DEGRADED", now, "LOW_OVERLAP", 0.3, "yard")
        watch.see_scan(np.array([[9.0, 9.0]]), now)
        follower.tick(now)
    follower.predictor.remember(now, follower.limiter.limit(1.0, 0.2, now, is_hard=False))
    watch.refuse_scan("blind")
    watch.refuse_pose("another frame", is_bad=True)


def test_a_jump_of_the_clock_leaves_nothing_that_was_heard_before(kit):
    path = kit.make_path([(0, 0), (40, 0)], PARAMS)
    follower, new = Follower(PARAMS, path), Follower(PARAMS, path)
    soil(follower)
    for name, fresh in state_of(new.watch).items():
        assert state_of(follower.watch)[name] != fresh, f"{name}: expected it to be used before the jump"
    follower.reset()
    for part in ("watch", "predictor", "consistency"):
        assert state_of(getattr(follower, part)) == state_of(getattr(new, part)), part
    assert follower.limiter.last_ns is None


def test_a_stamp_of_before_a_jump_of_the_clock_is_no_reason_not_to_answer():
    answers = []
    times = Times(lambda: SECOND, lambda: SECOND)
    answered, new = (Answered(times, answers.append, lambda _: None) for _ in range(2))
    answered.answer_pose(SECOND)
    answered.answer_status(SECOND, is_good=True, has_pose=True)
    answered.answer(SECOND)
    answered.forget()
    assert state_of(answered) == state_of(new)
