"""One test a reason to stop, and what is not one."""

import math

import numpy as np
import pytest

from path_follower.params import FollowerParams, SafetyParams
from path_follower.path import Location, Pose2
from path_follower.reasons import FINE, REMEDIES, StopReason, StopVerdict
from path_follower.safety import SafetyMonitor

SECOND = 1_000_000_000
PARAMS = FollowerParams()


def good_watch(now=10 * SECOND, params=PARAMS):
    watch = SafetyMonitor(params)
    assert watch.see_pose(Pose2(0, 0, 0), now)
    watch.see_status("TRACKING", now)
    return watch


def test_good_inputs_are_fine():
    assert good_watch().judge_inputs(10 * SECOND) is FINE


def test_nothing_heard_is_no_reason_to_drive():
    assert SafetyMonitor(PARAMS).judge_inputs(SECOND).reason is StopReason.POSE_TIMEOUT


@pytest.mark.parametrize(
    "state", ["LOST", "SEARCHING", "PROBATION", "NOT_LOCALISED", "NO_MAP", "UNCONFIGURED", "tracking", ""]
)
def test_only_tracking_and_degraded_allow_motion(state):
    watch = good_watch()
    watch.see_status(state, 10 * SECOND)
    assert watch.judge_inputs(10 * SECOND).reason is StopReason.NOT_LOCALISED


def test_degraded_is_slow_and_limited_in_time():
    watch, limit = good_watch(), PARAMS.safety.max_degraded_time
    for k in range(round(limit) + 3):
        now = (10 + k) * SECOND
        watch.see_pose(Pose2(0, 0, 0), now)
        watch.see_status("DEGRADED", now)
        assert watch.is_slow
        verdict = watch.judge_inputs(now)
        assert (verdict is FINE) == (k <= limit)
    assert verdict.reason is StopReason.LOCALISATION_DEGRADED
    assert verdict.value > verdict.limit == limit
    watch.see_status("TRACKING", now)
    assert watch.judge_inputs(now) is FINE


def test_an_old_pose_stops_by_its_stamp_even_if_it_comes_again():
    watch = good_watch()
    late = 10 * SECOND + round(1.1e9 * PARAMS.safety.max_pose_silence)
    assert not watch.see_pose(Pose2(0, 0, 0), 10 * SECOND)  # the same stamp again: frozen
    verdict = watch.judge_inputs(late)
    assert verdict.reason is StopReason.POSE_TIMEOUT
    assert verdict.value == pytest.approx(1.1 * PARAMS.safety.max_pose_silence)


def test_a_pose_from_the_past_changes_nothing():
    watch = good_watch()
    assert not watch.see_pose(Pose2(99, 0, 0), 9 * SECOND)
    assert watch.pose == Pose2(0, 0, 0)


@pytest.mark.parametrize("pose", [Pose2(math.nan, 0, 0), Pose2(0, math.inf, 0), Pose2(0, 0, math.nan)])
def test_a_pose_that_is_no_number_stops_and_is_not_kept(pose):
    watch = good_watch()
    assert not watch.see_pose(pose, 11 * SECOND)
    assert watch.judge_inputs(10 * SECOND).reason is StopReason.BAD_POSE
    assert watch.see_pose(Pose2(0, 0, 0), 12 * SECOND)
    watch.see_status("TRACKING", 12 * SECOND)
    assert watch.judge_inputs(12 * SECOND) is FINE


def test_a_silent_status_stops():
    watch = good_watch()
    later = 10 * SECOND + round(1.1e9 * PARAMS.safety.max_status_silence)
    watch.see_pose(Pose2(0, 0, 0), later)
    assert watch.judge_inputs(later).reason is StopReason.STATUS_TIMEOUT


def test_without_required_status_the_pose_is_enough():
    watch = SafetyMonitor(FollowerParams(safety=SafetyParams(is_status_required=False)))
    watch.see_pose(Pose2(0, 0, 0), SECOND)
    assert watch.judge_inputs(SECOND) is FINE


def test_a_scan_that_was_there_and_has_gone_stops():
    watch = good_watch()
    watch.see_scan(np.empty((0, 2)), 10 * SECOND - round(1.1e9 * PARAMS.safety.max_scan_silence))
    assert watch.judge_inputs(10 * SECOND).reason is StopReason.SCAN_TIMEOUT


def test_a_required_scan_must_come():
    params = FollowerParams(safety=SafetyParams(is_scan_required=True))
    assert good_watch(params=params).judge_inputs(10 * SECOND).reason is StopReason.SCAN_TIMEOUT


def test_the_emergency_stop_comes_first_and_survives_a_reset():
    watch = SafetyMonitor(PARAMS)
    watch.is_emergency = True
    watch.reset()
    assert watch.judge_inputs(SECOND).reason is StopReason.EMERGENCY_STOP


@pytest.mark.parametrize(("distance", "heading", "is_fine"), [(0.9, 0.9, True), (1.1, 0.0, False), (0.0, -1.1, False)])
def test_leaving_the_path_stops(distance, heading, is_fine):
    verdict = good_watch().judge_place(Location(5.0, 0, 50, distance, distance, heading))
    assert (verdict is FINE) == is_fine
    assert is_fine or verdict.reason is StopReason.OFF_PATH


def test_every_reason_has_a_remedy_of_one_line():
    assert set(REMEDIES) == set(StopReason)
    for reason in StopReason:
        text = str(StopVerdict(reason, 2.0, 1.0))
        assert "\n" not in text
        assert (REMEDIES[reason] in text) or reason is StopReason.NONE


def test_single_points_are_no_obstacle(kit):
    straight = kit.make_path([(0, 0), (40, 0)], PARAMS)
    watch, location = good_watch(), straight.begin_of(0)
    watch.see_scan(np.array([[2.0, 0.0], [math.nan, 1.0]]), 10 * SECOND)
    assert watch.judge_way(straight, location, 1.0) is FINE
    watch.see_scan(np.array([[2.0, 0.0], [2.0, 0.1]]), 10 * SECOND)
    assert watch.judge_way(straight, location, 1.0).reason is StopReason.OBSTACLE
