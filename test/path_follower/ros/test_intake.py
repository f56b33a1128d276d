"""What the follower is driven by: poses, or directions whose frame and source are checked."""

import itertools
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sensor_msgs.msg import LaserScan
from sphere_nav_msgs.msg import FollowerStatus
from tf2_msgs.msg import TFMessage

from path_follower.path import Pose2
from path_follower.ros.intake import Answered, DirectionIntake
from path_follower.ros.node import PathFollowerNode
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import State, Status
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions import (
    header,
    se3_to_odometry,
    se3_to_pose_stamped,
    se3_to_pose_with_covariance,
    se3_to_transform,
    stamp_ns,
    status_to_message,
)
from worlds.offline_follower import SECOND, drive, follower_bus, pose, speeds, status

STEP = SECOND // 20


@pytest.fixture
def bus():
    bus = OfflineBus()
    bus.add(PathFollowerNode, {"source": "homing", "enable_stamped_cmd_vel": True})
    return bus


def direction(bus, angle, stamp, frame="base_link"):
    list(bus.advance(stamp))
    bus.deliver("/homing/direction", se3_to_pose_stamped(SE3.from_planar(0.0, 0.0, angle), stamp, frame))
    return list(bus.settle())


def source(bus, state, stamp, **values):
    list(bus.advance(stamp))
    bus.deliver("/homing/status", FollowerStatus(header=header(stamp, "map"), state=state, **values))
    return list(bus.settle())


def test_every_direction_is_answered_by_a_command_with_its_stamp(bus):
    node = bus.nodes[0]
    assert isinstance(node.loop.intake, DirectionIntake)
    source(bus, "DRIVING", SECOND, progress=1.0, distance_to_end=4.0)
    assert not node.endpoints.call("start").success  # no direction yet
    direction(bus, 0.2, SECOND)
    assert node.endpoints.call("start").success
    for stamp in (SECOND + SECOND // 10, SECOND + SECOND // 5):
        said = {record.topic: record.message for record in direction(bus, 0.2, stamp)}
    assert said["/cmd_vel"].header.stamp.nanosec == SECOND // 5
    assert said["/cmd_vel"].twist.linear.x > 0.0
    assert said["/path_follower/status"].distance_to_end == 4.0


def test_pose_and_status_of_an_image_are_answered_whenever_its_clock_comes():
    for order in itertools.permutations(("clock", "pose", "status")):
        clock, answers = [SECOND], []
        answered = Answered(
            SimpleNamespace(now_ns=partial(max, clock)), answers.append, lambda _: None, is_patient=True
        )
        for part in order:
            if part == "clock":
                clock.append(SECOND + STEP)
            elif part == "pose":
                answered.answer_pose(SECOND + STEP)
            else:
                answered.answer_status(SECOND + STEP, is_good=True, has_pose=True)
        assert answers == [SECOND + STEP], order


def test_a_status_of_a_clock_that_is_wrong_does_not_make_the_next_one_old():
    answers = []
    answered = Answered(SimpleNamespace(now_ns=lambda: SECOND), answers.append, lambda _: None)
    for stamp in (SECOND + 3 * STEP, SECOND + STEP):
        answered.answer_status(stamp, is_good=False)
    assert answers == [SECOND, SECOND + STEP]


def test_a_source_in_doubt_is_answered_at_once(bus):
    source(bus, "DRIVING", SECOND)
    direction(bus, 0.0, SECOND)
    assert bus.nodes[0].endpoints.call("start").success
    for after, reason in ((0.1, "LOCALISATION_DEGRADED"), (0.4, "NOT_LOCALISED")):  # s: `safety.max_blind_time` is 0.35
        said = {record.topic: record.message for record in source(bus, "STOPPED", SECOND + int(after * SECOND))}
        assert said["/path_follower/status"].reason == reason


def test_a_direction_of_another_frame_is_refused_and_poses_are_not_listened_to(bus):
    direction(bus, 0.0, SECOND, "map")
    told = next(item for item in bus.nodes[0].inputs if item.topic == "homing/direction")
    assert "header.frame_id: expected 'base_link', found 'map'" in told.last_refusal
    assert bus.nodes[0].loop.follower.direction is None
    bus.deliver("/pose", se3_to_pose_with_covariance(SE3.identity(), np.eye(6), SECOND, "map"))
    assert list(bus.settle()) == []


# --- stamps
AHEAD = [11 * 10**7, 3600 * SECOND]


@pytest.mark.parametrize("lead", AHEAD)
def test_a_pose_from_the_future_is_refused_by_name_and_the_drive_goes_on(lead):
    bus, node = follower_bus()
    x = drive(bus, node, 30)
    pose(bus, x + 5.0, bus.now_ns + lead)
    told = next(item for item in node.inputs if item.topic == "pose")
    assert f"found {lead / SECOND:.3f} s" in told.last_refusal
    drive(bus, node, 10, x=x)
    assert node.loop.follower.mode.is_driving
    assert node.loop.follower.watch.pose.x < x + 2.0


def test_poses_before_1970_are_refused_and_stop_as_fast_as_silence():
    bus, node = follower_bus()
    x = drive(bus, node, 30)
    begun, last = bus.now_ns, 0.0
    told = next(item for item in node.inputs if item.topic == "pose")
    for _ in range(15):
        for item in bus.advance(bus.now_ns + SECOND // 10):
            if item.topic == "/cmd_vel" and item.message.twist.linear.x != 0.0:
                last = (item.stamp_ns - begun) / SECOND
        message = se3_to_pose_with_covariance(SE3.from_planar(x, 0, 0), 1e-4 * np.eye(6), bus.now_ns, "map")
        message.header.stamp.sec = -1
        bus.deliver("/pose", message)
        list(bus.settle())
    assert "stamp: expected 0 to 2^31 s, found -" in told.last_refusal
    assert "stamp: expected 0 to 2^31 s, found -" in node.loop.follower.mode.verdict.detail
    assert last <= 0.8


def seconds_to_zero(bus):
    begun, last = bus.now_ns, 0.0
    for item in bus.advance(begun + 3 * SECOND):
        if item.topic == "/cmd_vel" and item.message.twist.linear.x != 0.0:
            last = (item.stamp_ns - begun) / SECOND
    return last + 0.025  # the command after it


@pytest.mark.slow
@settings(deadline=None, max_examples=25, derandomize=True)
@given(
    stamps=st.lists(
        st.tuples(
            st.sampled_from(["pose", "status", "LOST"]),
            st.one_of(st.integers(-(2**31) * SECOND, 2**31 * SECOND), st.integers(-SECOND, SECOND)),
            st.integers(0, SECOND // 20),
        ),
        max_size=12,
    )
)
def test_no_stamp_however_wrong_delays_a_stop(stamps):
    """Messages with any stamps, in any order, then silence: zero command no later than without them, but for a tick."""
    bus, node = follower_bus()
    x = drive(bus, node, 30)
    for kind, offset, pause in stamps:
        stamp = min(max(bus.now_ns + offset, 0), 2**31 * SECOND - 1)
        list(bus.advance(bus.now_ns + pause))
        if kind == "pose":
            pose(bus, x, stamp)
        else:
            status(bus, "TRACKING" if kind == "status" else kind, stamp)
        list(bus.settle())
    assert seconds_to_zero(bus) <= 0.8
    assert node.loop.follower.mode.state == "STOPPED"


def test_bad_news_counts_whatever_its_stamp():
    for stamp in (-1, 10**18):
        bus, node = follower_bus()
        drive(bus, node, 30)
        message = status_to_message(Status(State.LOST, ""), max(stamp, 0), "map")
        message.header.stamp.sec = min(stamp, message.header.stamp.sec)
        bus.deliver("/status", message)
        assert seconds_to_zero(bus) <= 0.4
        assert node.loop.follower.mode.verdict.reason == "NOT_LOCALISED"


def test_a_status_that_never_has_a_pose_is_told_at_the_sixteenth():
    bus, node = follower_bus()
    for _ in range(16):
        status(bus, "TRACKING", bus.now_ns)
        list(bus.advance(bus.now_ns + SECOND // 100))
    told = next(item for item in node.inputs if item.topic == "status")
    assert "expected that of a pose, found another one 16 times" in told.last_refusal


@pytest.mark.parametrize("lost", ["LOST", "DEGRADED", "silent"])
def test_a_status_of_other_images_does_not_hide_what_the_localiser_says(lost):
    bus, node = follower_bus()
    x = drive(bus, node, 30)
    begun, last, speed = bus.now_ns, 0.0, 1.4
    for k in range(1, 30):
        said = list(bus.advance(begun + k * SECOND // 10))
        x += 0.1 * speed
        pose(bus, x, bus.now_ns)
        if lost != "silent":
            status(bus, lost, bus.now_ns, "LOW_OVERLAP", age=0.1 * k)
        said += bus.settle()
        for _ in range(5):  # a second publisher, whatever it is called
            said += bus.advance(bus.now_ns + SECOND // 100)
            status(bus, "TRACKING", bus.now_ns)
            said += bus.settle()
        speed = speeds(said)[-1]
        last = (bus.now_ns - begun) / SECOND if speed else last
    verdict = node.loop.follower.mode.verdict
    assert verdict.reason == ("STATUS_TIMEOUT" if lost == "silent" else "NOT_LOCALISED")
    assert last <= (2.0 if lost == "silent" else 1.0)


# --- scans
def scan(bus, ranges, **fields):
    usual = {"angle_min": -1.0, "angle_max": 1.0, "angle_increment": 0.05, "range_min": 0.1, "range_max": 20.0}
    usual["header"] = header(bus.now_ns, "laser")
    message = LaserScan(ranges=[float(r) for r in ranges], **(usual | fields))
    bus.deliver("/scan", message)
    list(bus.settle())


def mount(bus, roll=0.0, yaw=0.0):
    T_base_laser = SE3.from_angles(roll, 0.0, yaw, np.array([1.5, 0.3, 0.6]))
    there = se3_to_transform(T_base_laser, bus.now_ns, "base_link", "laser")
    bus.deliver("/tf_static", TFMessage(transforms=[there]))
    scan(bus, 41 * [np.inf])
    list(bus.advance(bus.now_ns + SECOND // 4))  # its frame is known now, and where that is


def drive_with_scans(bus, node, images, ranges, x=0.0, **fields):
    """Drive with a scan for each pose; return where the vehicle is and the reasons it gave."""
    reasons = set()
    for _ in range(images):
        x = drive(bus, node, 1, x=x)
        scan(bus, ranges, **fields)
        reasons.add(str(node.loop.follower.mode.verdict.reason))
    return x, reasons


def started_with_scans(**values):
    bus, node = follower_bus(**values)
    mount(bus)
    x = drive(bus, node, 2)
    scan(bus, 41 * [np.inf])
    assert node.endpoints.call("start").success
    x, reasons = drive_with_scans(bus, node, 15, 41 * [np.inf], x)
    assert reasons == {""}
    return bus, node, x


@pytest.mark.parametrize(
    ("roll", "yaw", "place"),
    [
        (0.0, 0.5, (1.5 + 2 * np.cos(1.0), 0.3 + 2 * np.sin(1.0))),
        (0.0, np.pi, (1.5 - 2 * np.cos(0.5), 0.3 - 2 * np.sin(0.5))),  # looks behind
        (np.pi / 2, 0.0, (1.5 + 2 * np.cos(0.5), 0.3)),  # on its side: the beam goes up
        (np.pi, 0.0, (1.5 + 2 * np.cos(0.5), 0.3 - 2 * np.sin(0.5))),  # upside down: to the right
    ],
    ids=["turned", "behind", "on its side", "upside down"],
)
def test_a_scanner_sees_a_post_where_it_is_however_it_is_mounted(roll, yaw, place):
    bus, node = follower_bus()
    mount(bus, roll, yaw)
    scan(bus, [2.0 if beam == 30 else np.inf for beam in range(41)])  # 0.5 rad to the scanner's left
    np.testing.assert_allclose(node.loop.follower.watch.points, [place], atol=1e-6)


@pytest.mark.parametrize(("roll", "sense"), [(0.0, 1.0), (np.pi, 1.0), (0.0, -1.0)])
@pytest.mark.parametrize("is_ahead", [False, True])
def test_a_turned_scanner_that_is_blind_where_the_vehicle_drives_is_none(roll, sense, is_ahead):
    """What is ahead of a vehicle is 0.6 rad to the right of a scanner that looks to the left; turned over, left.

    sense: counts clockwise where it is negative.
    """
    bus, node = follower_bus()
    mount(bus, roll, yaw=0.6)
    x = drive(bus, node, 2)
    scan(bus, 41 * [np.inf])
    drive(bus, node, 1, x=x)
    is_right_blind = (roll == 0.0) == is_ahead
    angles = sense * np.linspace(-1.0, 1.0, 41)
    fields = {"angle_min": -sense, "angle_max": sense, "angle_increment": 0.05 * sense}
    scan(bus, np.where((angles < -0.1) if is_right_blind else (angles > 0.1), np.nan, np.inf), **fields)
    assert ("of the way ahead measured" in node.loop.follower.watch.scan_refusal) == is_ahead


BLIND_AHEAD = 10 * [np.inf] + 21 * [np.nan] + 10 * [np.inf]


@pytest.mark.parametrize(
    ("ranges", "fields", "found"),
    [
        (41 * [np.nan], {}, "of the beams to measure, as lately, found 0%"),
        (BLIND_AHEAD, {}, "of the way ahead measured"),
        (41 * [np.inf], {"angle_increment": 0.0}, "angle_increment: expected 41 beams"),
        (41 * [np.inf], {"header": header(SECOND, "nowhere")}, "nowhere"),
        (41 * [np.inf], {"header": header(3600 * SECOND, "laser")}, "ahead of the clock"),
    ],
)
def test_a_scan_that_sees_nothing_where_it_saw_something_is_none(ranges, fields, found):
    bus, node, x = started_with_scans()
    stood = x
    x, _ = drive_with_scans(bus, node, 10, ranges, x, **fields)
    verdict = node.loop.follower.mode.verdict
    assert (verdict.reason, found in verdict.detail) == ("SCAN_TIMEOUT", True), verdict.detail
    assert x - stood < 1.2
    assert not node.endpoints.call("start").success


def test_scans_that_measure_are_driven_by_also_where_nothing_is_in_range_or_much_is_hidden_by_the_body():
    bus, node, x = started_with_scans()
    for ranges in (41 * [np.inf], 41 * [19.0], 41 * [25.0], 5 * [np.nan] + 31 * [np.inf] + 5 * [0.05]):
        x, reasons = drive_with_scans(bus, node, 10, ranges, x)
        assert reasons == {""}, ranges
    x, reasons = drive_with_scans(bus, node, 1, BLIND_AHEAD, x)  # one alone: the time has not come
    x, more = drive_with_scans(bus, node, 10, 41 * [np.inf], x)
    assert reasons | more == {""}


@pytest.mark.parametrize("is_required", [False, True])
def test_a_scanner_without_tf_is_no_reason_to_drive_as_if_there_were_none(is_required):
    bus, node = follower_bus(**{"safety.is_scan_required": is_required})
    x = drive(bus, node, 2)
    assert node.endpoints.call("start").success != is_required
    scan(bus, 41 * [np.inf])
    answer = node.endpoints.call("start") if is_required else node.loop.follower.watch.judge_inputs(bus.now_ns)
    assert "laser" in str(answer)
    drive(bus, node, 1, x=x)
    assert not node.endpoints.call("start").success
    mount(bus)
    scan(bus, 41 * [np.inf])
    for _ in range(20):
        x = drive(bus, node, 1, x=x)
        scan(bus, 41 * [np.inf])
    assert node.endpoints.call("start").success


def test_a_scanner_that_looks_elsewhere_is_enough_only_where_none_is_required():
    for is_required in [False, True]:
        bus, node = follower_bus(**{"safety.is_scan_required": is_required})
        mount(bus, yaw=np.pi)
        drive(bus, node, 2)
        scan(bus, 41 * [np.inf])
        answer = node.endpoints.call("start")
        assert answer.success != is_required
        assert is_required == ("expected beams where the vehicle drives" in answer.message)


def test_a_scanner_has_to_see_as_far_as_the_vehicle_drives_now():
    """Blind 0.3 rad to both sides: of the way of 1.4 m/s it measures a little more than half, of that of 2 m/s less."""
    bus, node, _ = started_with_scans()
    for cruise, is_blind in [(1.4, False), (2.0, True)]:
        node.tune(replace(node.params, speed=replace(node.params.speed, cruise=cruise)))
        scan(bus, 14 * [np.inf] + 13 * [np.nan] + 14 * [np.inf])
        assert ("of the way ahead measured" in node.loop.follower.watch.scan_refusal) == is_blind


def test_wheels_of_another_frame_are_refused():
    bus, node = follower_bus()
    drive(bus, node, 1)
    twist = [1.0, 0, 0, 0, 0, 0.2]
    message = se3_to_odometry(SE3.from_planar(4, 5, 0.6), np.eye(6), bus.now_ns, ("odom", "base_link"), twist)
    bus.deliver("/odom", message)
    list(bus.settle())
    time, T_odom_base, twist = node.loop.follower.watch.consistency._odometry[-1]
    assert (*Pose2.of(T_odom_base), twist[0], twist[5]) == pytest.approx((4, 5, 0.6, 1.0, 0.2))
    assert time == node.loop.endpoints.own_ns()
    message.child_frame_id = "front_axle"
    bus.deliver("/odom", message)
    told = next(item for item in node.inputs if item.topic == "odom")
    assert "child_frame_id: expected 'base_link', found 'front_axle'" in told.last_refusal
    assert not told.is_required


def test_a_covariance_is_judged_in_the_axes_of_a_vehicle_that_heads_along_y():
    """Large along the map's x axis: on a vehicle that heads along y that is to its side."""
    for source in ["pose", "odometry"]:
        bus, node = follower_bus(source=source)
        T_map_base = SE3.from_planar(1.0, 0.0, np.pi / 2)
        covariance = np.diag([1e-4, 2.25, 1.0, 1.0, 1.0, 1e-4])
        if source == "pose":
            message = se3_to_pose_with_covariance(T_map_base, covariance, bus.now_ns, "map")
            assert message.pose.covariance[0] == pytest.approx(2.25)
        else:
            message = se3_to_odometry(T_map_base, covariance, bus.now_ns, ("map", "base_link"))
        bus.deliver(f"/{source}", message)
        stop = node.loop.follower.watch.doubt.stop
        assert (stop.reason, stop.value, stop.limit) == ("POSE_UNCERTAIN", pytest.approx(1.5), 1.0)


def test_a_pose_is_of_the_map_that_its_status_names():
    bus, node = follower_bus()
    bus.deliver("/status", status_to_message(Status(State.TRACKING, map_id="yard"), bus.now_ns, "map"))
    pose(bus, 0.0, bus.now_ns)
    assert node.loop.follower.watch.map_id == "yard"


# --- simulated time
def simulated_bus(monkeypatch):
    monkeypatch.setattr("sphere_nav.ros.bags.replay.OfflineShell.is_time_simulated", True)
    return follower_bus()


def answers(bus):
    return [stamp_ns(item.message) for item in bus.settle() if item.topic == "/cmd_vel"]


def test_where_time_is_simulated_a_pose_is_answered_once_its_status_is_known(monkeypatch):
    bus, _ = simulated_bus(monkeypatch)
    for k in range(12, 15):
        now = k * SECOND // 10
        list(bus.advance(now))
        pose(bus, 0.0, now)
        assert answers(bus) == []
        status(bus, "TRACKING", now)
        assert answers(bus) == [now]
    list(bus.advance(15 * SECOND // 10))
    status(bus, "DEGRADED", bus.now_ns, "BAD_INFO", 0.1)  # an image that gave no pose is answered, too
    assert answers(bus) == [bus.now_ns]
    list(bus.advance(16 * SECOND // 10))
    status(bus, "TRACKING", bus.now_ns)
    pose(bus, 0.0, bus.now_ns)  # of a localiser that publishes it after its status
    assert answers(bus) == [bus.now_ns] * 2
    list(bus.advance(17 * SECOND // 10))
    status(bus, "TRACKING", bus.now_ns, milliseconds=30.0)  # its pose is on the way
    assert answers(bus) == []
    bad = se3_to_pose_with_covariance(SE3.identity(), np.eye(6), bus.now_ns, "another")
    bus.deliver("/pose", bad)  # refused, and answered: no other is to come
    assert answers(bus) == [bus.now_ns]


@pytest.mark.parametrize("lag", [3, 19])
def test_a_clock_that_is_looked_at_late_changes_no_command(monkeypatch, lag):
    """Poses 0.2 s apart, ticks of the wall before, between and after them; one pose is missing, and then several."""

    def commands(looks):
        bus, node = simulated_bus(monkeypatch)
        node.endpoints.own_ns = node.endpoints.now_ns
        sent, x = [], 0.0
        for k in range(6, 60):
            now = k * SECOND // 5
            for look in looks:
                bus.now_ns = now - SECOND // 5 + look
                node.loop.on_tick()
            bus.now_ns = now
            if k % 20 not in (8, 14, 15, 16):
                pose(bus, x, now)
                status(bus, "TRACKING", now)
            sent += [(stamp_ns(m.message), m.message.twist) for m in bus.settle() if m.topic == "/cmd_vel"]
            x += 0.05
            if k in (10, 37):
                assert node.endpoints.call("start").success
        return sent

    rare, often = commands([]), commands([(k + lag) * SECOND // 100 for k in range(1, 20 - lag)])
    assert rare == often
    assert max(twist.linear.x for _, twist in rare) > 0.2
