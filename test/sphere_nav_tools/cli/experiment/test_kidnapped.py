"""Starts from nowhere: who has the wheel, and how a start is judged; none is driven here."""

from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from sphere_nav_msgs.msg import LocalizationStatus

from cycab_sim.vehicle import VehicleCommand
from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.ros.conversions import ns_to_time
from sphere_nav_tools.cli.experiment.kidnapped import (
    HandOver,
    Kidnapped,
    Start,
    draw_starts,
    judge_start,
    kidnap_figures,
)

S = 1_000_000_000


def stamped(message, ns):
    message.header.stamp = ns_to_time(ns)
    return message


@pytest.fixture
def bench():
    """What stands between follower and car, without a network: `published`, and the three callbacks."""
    published, heard = [], {}
    node = SimpleNamespace(
        create_publisher=lambda *_: SimpleNamespace(publish=published.append),
        create_subscription=lambda kind, topic, callback, _: heard.update({topic: callback}),
    )
    human = SimpleNamespace(command=lambda state: VehicleCommand(1.2, 0.1 * state.x))
    return SimpleNamespace(hand=HandOver(SimpleNamespace(node=node), human), published=published, heard=heard)


def answer(bench, ns, x=4.0, speed=0.7):
    """Let the follower answer an image, then mcl_depth, then the truth come."""
    command = stamped(TwistStamped(), ns)
    command.twist.linear.x = speed
    bench.heard["follower/cmd_vel"](command)
    bench.heard["mcl/status"](stamped(LocalizationStatus(), ns))
    told = len(bench.published)
    truth = stamped(Odometry(), ns)
    truth.pose.pose.position.x, truth.pose.pose.orientation.w = x, 1.0
    bench.heard["ground_truth/odometry"](truth)
    assert len(bench.published) == told + (not bench.hand.is_held)  # it waits for the truth, too


def test_a_human_drives_until_the_follower_may(bench):
    bench.hand.is_held = False
    answer(bench, 2 * S)
    assert (bench.published[0].twist.linear.x, bench.published[0].twist.angular.z) == (1.2, 0.4)
    bench.hand.is_braking = True
    answer(bench, 3 * S)
    assert bench.published[1].twist.linear.x == 0.0
    bench.hand.is_by_hand = False
    answer(bench, 4 * S)
    assert bench.published[2].twist.linear.x == 0.7


def test_nothing_passes_before_mcl_depth_has_seen_the_image(bench):
    bench.hand.is_held = False
    bench.heard["mcl/status"](stamped(LocalizationStatus(), 1 * S))
    bench.heard["ground_truth/odometry"](stamped(Odometry(), 3 * S))
    bench.heard["follower/cmd_vel"](stamped(TwistStamped(), 2 * S))
    assert not bench.published
    bench.heard["mcl/status"](stamped(LocalizationStatus(), 2 * S))
    assert len(bench.published) == 1


def test_time_stands_at_the_image_whose_answer_is_held(bench):
    assert bench.hand.now_ns == 0
    bench.heard["follower/cmd_vel"](stamped(TwistStamped(), 2 * S))
    assert bench.hand.now_ns == 0  # of a time between two images
    bench.heard["mcl/status"](stamped(LocalizationStatus(), 3 * S))
    assert bench.hand.now_ns == 3 * S
    bench.heard["ground_truth/odometry"](stamped(Odometry(), 3 * S))
    assert not bench.published
    bench.hand.release()
    assert len(bench.published) == 1
    bench.hand.is_held = True
    bench.heard["follower/cmd_vel"](stamped(TwistStamped(), 2 * S))  # once more: time passes nevertheless
    assert bench.hand.now_ns == 0


def test_starts_are_drawn_by_the_seed_with_room_ahead():
    starts = draw_starts(100.0, 5, 40)
    assert starts == draw_starts(100.0, 5, 40) != draw_starts(100.0, 6, 40)
    assert 30.0 < max(start.along for start in starts) <= 60.0
    assert max(abs(start.left) for start in starts) <= 0.5 < max(abs(start.turned) for start in starts) <= 10.0


def line(stamps, xs, y=0.0):
    return Trajectory(np.array(stamps) * S, SE3(np.stack([SE3.from_planar(float(x), y, 0.0).matrix for x in xs])))


def test_a_start_is_judged_by_what_both_said_and_how_far_the_car_went():
    truth = line(range(1, 12), [90.0, *range(10)])  # at 1 s it still is where it was
    coarse, fine = line([5, 6], [3.6, 4.0]), line([6, 7, 8, 9], [4.0, 5.5, 6.0, 7.1])
    found = judge_start(Start(0.0, 0.0, 0.0, begun=1 * S, taken=6 * S, ended=11 * S), truth, fine, coarse)
    assert found["coarse_m"] == pytest.approx(0.6)
    assert found["fine_m"] == pytest.approx(0.5)
    assert found["by_hand_m"] == 4.0
    assert found["by_itself_m"] == 4.0
    assert found["wrong_m"] == pytest.approx(1.0)  # from 7 to 8 s
    nothing = judge_start(Start(0.0, 0.0, 0.0, begun=1 * S, ended=11 * S), truth, fine[:0], coarse[:0])
    assert np.isnan(nothing["coarse_m"])
    assert (nothing["by_hand_m"], nothing["by_itself_m"], nothing["wrong_m"]) == (9.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("change", "share"),
    [({}, 100.0), ({"coarse_m": 1.1}, 50.0), ({"fine_m": 0.4}, 50.0), ({"by_itself_m": 9.0}, 50.0),
     ({"coarse_m": np.nan}, 50.0)],
)  # fmt: skip
def test_a_start_counts_where_all_of_it_went_well(change, share):
    good = {"coarse_m": 0.7, "fine_m": 0.1, "by_hand_m": 8.0, "by_itself_m": 10.0, "wrong_m": 0.0}
    found = {figure.name: figure for figure in kidnap_figures([good, good | {"by_hand_m": 10.0} | change])}
    judged = found["starts found, right, and driven from"]
    assert judged.value == share
    assert judged.is_met is (share == 100.0)
    assert found["way by hand until the follower starts, median"].value == 9.0


def test_it_searches_for_nothing_that_mcl_depth_has_not_found():
    assert Kidnapped.localizer == {"automatic": False}
    assert Kidnapped.topics["dense_localizer"]["other/pose"] == Kidnapped.topics["mcl_depth"]["pose"] == "mcl/pose"
