"""One test a reason to stop, and what is not one."""

import math

import numpy as np
import pytest

from path_follower.constants import SENSOR_SILENCE
from path_follower.params import FollowerParams, SafetyParams
from path_follower.path import Location, Pose2
from path_follower.reasons import FINE, StopReason, describe
from path_follower.safety import SafetyMonitor
from path_follower.vehicle import Predictor
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import Verdict

SECOND = 1_000_000_000
PARAMS = FollowerParams()


def good_watch(params=PARAMS):
    watch = SafetyMonitor(params, Predictor(params.vehicle, params.actuation))
    watch.see_pose(SE3.identity(), 10 * SECOND)
    watch.see_status("TRACKING", 10 * SECOND)
    return watch


def test_only_tracking_and_degraded_allow_motion():
    for state in ["LOST", "SEARCHING", "PROBATION", "NOT_LOCALISED", "NO_MAP", "UNCONFIGURED", "tracking", ""]:
        watch = good_watch()
        watch.see_status(state, 10 * SECOND)
        assert watch.judge_inputs(10 * SECOND).reason is StopReason.NOT_LOCALISED


def test_degraded_is_slow_and_limited_in_time():
    watch, limit = good_watch(), 10.0
    for k in range(round(limit) + 3):
        now = (10 + k) * SECOND
        watch.see_pose(SE3.identity(), now)
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
    watch.see_pose(SE3.identity(), 10 * SECOND)  # the same stamp again: frozen
    verdict = watch.judge_inputs(late)
    assert verdict.reason is StopReason.POSE_TIMEOUT
    assert verdict.value == pytest.approx(1.1 * PARAMS.safety.max_pose_silence)


def test_what_a_reason_may_need_is_known_the_tilt_of_the_pose_its_speed_and_the_wheels():
    watch, T_map_base = good_watch(), SE3.from_angles(0.1, -0.2, 0.3, [1.0, 2.0, 3.0])
    watch.see_pose(T_map_base, 11 * SECOND, 0.7)
    watch.consistency.see_odometry(Pose2(5.0, 0.0, 0.0), 0.6, 0.1, 11 * SECOND)
    assert (watch.T_map_base, watch.speed, watch.pose) == (T_map_base, 0.7, Pose2(1.0, 2.0, pytest.approx(0.3)))
    assert watch.consistency.wheels_at(11 * SECOND)[1:] == (0.6, 0.1)
    watch.reset()
    assert (watch.T_map_base, watch.speed, watch.pose, watch.consistency.wheels_at(11 * SECOND)) == (None,) * 4


def test_a_pose_that_is_no_number_stops_and_is_not_kept():
    for pose in [Pose2(math.nan, 0, 0), Pose2(0, math.inf, 0), Pose2(0, 0, math.nan)]:
        watch = good_watch()
        watch.see_pose(SE3.from_planar(*pose), 11 * SECOND)
        assert watch.judge_inputs(10 * SECOND).reason is StopReason.BAD_POSE
        assert watch.pose == Pose2(0, 0, 0)
        watch.see_pose(SE3.identity(), 12 * SECOND)
        watch.see_status("TRACKING", 12 * SECOND)
        assert watch.judge_inputs(12 * SECOND) is FINE


def test_a_scan_that_was_there_and_has_gone_stops():
    watch = good_watch()
    watch.see_scan(np.empty((0, 2)), 10 * SECOND - round(1.1e9 * SENSOR_SILENCE))
    assert watch.judge_inputs(10 * SECOND).reason is StopReason.SCAN_TIMEOUT


def test_leaving_the_path_stops():
    for distance, heading, is_fine in [(0.9, 0.9, True), (1.1, 0.0, False), (0.0, -1.1, False), (0.0, 1.1, False)]:
        verdict = good_watch().judge_place(Location(5.0, 0, 50, distance, distance, heading))
        assert (verdict is FINE) == is_fine
        assert is_fine or verdict.reason is StopReason.OFF_PATH


def test_a_second_commander_stops_and_an_emergency_stop_comes_first_and_survives_a_reset():
    watch = good_watch()
    watch.outside = Verdict(StopReason.POSE_SOURCE, 2, 1)
    assert watch.judge_inputs(10 * SECOND) is watch.outside
    watch.is_emergency = True  # goes before all others
    assert watch.judge_inputs(10 * SECOND).reason is StopReason.EMERGENCY_STOP
    watch.reset()
    assert watch.judge_inputs(10 * SECOND).reason is StopReason.EMERGENCY_STOP


def test_a_pose_that_cannot_be_used_stops_at_once_where_it_is_bad_and_else_by_the_silence_that_follows():
    watch = good_watch()
    watch.refuse_pose("stamp ahead", is_bad=False)
    assert watch.judge_inputs(10 * SECOND) is FINE
    later = 10 * SECOND + round(1.1e9 * PARAMS.safety.max_pose_silence)
    assert "refused: stamp ahead" in str(watch.judge_inputs(later))
    watch.refuse_pose("wrong frame", is_bad=True)
    verdict = watch.judge_inputs(10 * SECOND)
    assert (verdict.reason, verdict.detail) == (StopReason.BAD_POSE, "wrong frame")


def test_a_camera_that_repeats_an_image_stops_although_the_pose_goes_on():
    for state in ["TRACKING", "DEGRADED"]:
        watch = good_watch()
        watch.see_status(state, 10 * SECOND, "FROZEN", 0.1)
        verdict = watch.judge_inputs(10 * SECOND)
        assert (verdict.reason, verdict.detail) == (StopReason.NOT_LOCALISED, "the camera repeats an image")


def test_a_drive_on_predicted_poses_is_limited_in_time():
    watch, limit = good_watch(), PARAMS.safety.max_blind_time
    for age in (0.1, 0.2, 0.3, 0.4):
        now = 10 * SECOND + round(age * SECOND)
        watch.see_pose(SE3.identity(), now)
        watch.see_status("DEGRADED", now, "LOW_OVERLAP", age)
        verdict = watch.judge_inputs(now)
        assert (verdict is FINE) == (age <= limit)
    assert (verdict.reason, verdict.limit) == (StopReason.NOT_LOCALISED, limit)
    assert verdict.value == pytest.approx(0.4)
    watch.see_status("DEGRADED", now, "LOW_OVERLAP", 0.0)  # an image confirms the pose
    assert watch.judge_inputs(now) is FINE


def test_blindness_counts_from_the_last_image_that_confirmed_the_pose_but_not_from_before_the_last_status():
    watch = good_watch()
    watch.see_status("TRACKING", 10 * SECOND + 300_000_000, "GAP", 0.2)
    assert watch.judge_inputs(10 * SECOND + 440_000_000).value == pytest.approx(0.44)  # no pose for so long
    watch.see_pose(SE3.identity(), 10 * SECOND + 440_000_000)
    assert watch.judge_inputs(10 * SECOND + 440_000_000) is FINE  # 0.2 + 0.14 s
    assert watch.judge_inputs(10 * SECOND + 460_000_000).value == pytest.approx(0.36)
    fresh = good_watch()
    fresh.see_status("TRACKING", 10 * SECOND + 100_000_000, "GAP", 1000.0)
    assert fresh.judge_inputs(10 * SECOND + 300_000_000) is FINE


def test_good_news_that_comes_late_changes_nothing():
    for state in ["TRACKING", "DEGRADED"]:
        watch = good_watch()
        watch.see_status("LOST", 10 * SECOND)
        watch.see_status(state, 10 * SECOND - 1)
        assert watch.judge_inputs(10 * SECOND).reason is StopReason.NOT_LOCALISED
        watch.see_status(state, 10 * SECOND)
        assert watch.judge_inputs(10 * SECOND) is FINE


def test_a_scan_that_cannot_be_used_is_none_at_once_where_there_never_was_one_and_else_by_its_silence():
    for is_required in [False, True]:
        watch = good_watch(params=FollowerParams(safety=SafetyParams(is_scan_required=is_required)))
        watch.refuse_scan("no transform")
        verdict = watch.judge_inputs(10 * SECOND)
        assert (verdict.reason, verdict.detail) == (StopReason.SCAN_TIMEOUT, "no scan yet (refused: no transform)")
        watch.see_scan(np.empty((0, 2)), 10 * SECOND)
        assert watch.judge_inputs(10 * SECOND) is FINE
        watch.see_scan(np.empty((0, 2)), 10 * SECOND - round(0.9e9 * SENSOR_SILENCE))
        watch.refuse_scan("blind")
        assert watch.judge_inputs(10 * SECOND) is FINE
        watch.scan_ns -= round(0.2e9 * SENSOR_SILENCE)
        assert "0.44 s, limit 0.4 (refused: blind)" in watch.judge_inputs(10 * SECOND).detail


def test_a_localizer_that_says_nothing_is_no_reason_to_drive():
    watch = good_watch()
    watch.reset()
    watch.see_pose(SE3.identity(), SECOND)
    verdict = watch.judge_inputs(SECOND)
    assert (verdict.reason, verdict.detail) == (StopReason.STATUS_TIMEOUT, "no status yet")


@pytest.mark.parametrize(
    ("pose", "reason"),
    [
        (Pose2(5.0, 0.3, 0.2), None),
        (Pose2(5.0, 1.5, 0.0), StopReason.OFF_PATH),
        (Pose2(5.0, -1.5, 0.0), StopReason.OFF_PATH),
        (Pose2(5.0, 0.0, 2.0), StopReason.OFF_PATH),
        (Pose2(5.0, 0.0, -2.0), StopReason.OFF_PATH),
    ],
)
@pytest.mark.parametrize("has_driven", [False, True])
def test_a_start_is_where_the_vehicle_stands_on_the_path(kit, pose, reason, has_driven):
    straight = kit.make_path([(0, 0), (40, 0)], PARAMS)
    watch = good_watch()
    watch.see_pose(SE3.from_planar(*pose), 11 * SECOND)
    last = straight.advance(Pose2(4.5, 0, 0), straight.begin_of(0), 10.0) if has_driven else None
    verdict, place = watch.find_start(straight, last)
    if reason is None:
        assert verdict is FINE
        assert (place.arc_length, place.cross_track) == pytest.approx((5.0, 0.3))
        watch.see_scan(np.array([[1.8, -0.1], [1.8, 0.1]]), 11 * SECOND)
        assert watch.find_start(straight, last)[0].reason is StopReason.OBSTACLE
    else:
        assert (verdict.reason, verdict.value) == (reason, 1.5 if pose.y else math.pi)


def test_a_start_after_a_stop_is_looked_for_two_meters_ahead(kit):
    straight, watch = kit.make_path([(0, 0), (40, 0)], PARAMS), good_watch()
    watch.see_pose(SE3.from_planar(7.2, 0, 0), 11 * SECOND)
    last = straight.advance(Pose2(4.5, 0, 0), straight.begin_of(0), 10.0)
    assert watch.find_start(straight, last)[1].arc_length == pytest.approx(6.5, abs=0.11)  # one edge of 0.1 m


def test_every_reason_has_a_remedy_of_one_line():
    for reason in list(StopReason)[1:]:
        text = describe(Verdict(reason, 2.0, 1.0))
        assert "\n" not in text
        assert reason.remedy
        assert reason.remedy in text


def test_single_points_are_no_obstacle(kit):
    straight = kit.make_path([(0, 0), (40, 0)], PARAMS)
    watch, location = good_watch(), straight.begin_of(0)
    watch.see_scan(np.array([[2.0, 0.0], [math.nan, 1.0]]), 10 * SECOND)
    assert watch.judge_path(straight, location, 1.0) is FINE
    watch.see_scan(np.array([[2.0, 0.0], [2.0, 0.1]]), 10 * SECOND)
    assert watch.judge_path(straight, location, 1.0).reason is StopReason.OBSTACLE
