"""The node route_navigator with the node path_follower: missions on an offline bus."""

import json
import math

import numpy as np
import pytest
from sphere_nav_msgs.msg import LocalizationStatus
from sphere_nav_msgs.srv import CloseEdge, PlanRoute

from path_follower.path import Pose2
from path_follower.routes.building import TaughtDrive, build_network
from path_follower.routes.network import Spot
from path_follower.routes.network_file import write_network
from path_follower.vehicle import Motion, drive
from sphere_nav.geometry import SE3
from sphere_nav.ros.conversions import se3_to_pose_stamped
from worlds.curves import even_curve
from worlds.trip import Trip

WAY_AROUND = ((5, 0), (4, 1 / 8), (8, -1 / 8), (4, 1 / 8), (19, 0))


def course(pieces):
    pose, poses = Pose2(0.0, 0.0, 0.0), [Pose2(0.0, 0.0, 0.0)]
    for length, bend in pieces:
        for _ in range(round(length * 10)):
            pose = drive(pose, Motion(1.0, math.atan(1.2 * bend)), 1.2, 0.1)
            poses.append(pose)
    x, y, yaw = np.array(poses).T
    return TaughtDrive(even_curve(x, y, yaw, np.full(len(x), 1.4)))


@pytest.fixture
def folder(tmp_path):
    """40 m of road with a way around a part of it; the place `end` is 35 m along."""
    network = build_network([course([(40, 0)]), course(WAY_AROUND)], "campus")
    last = next(edge for edge in network.edges.values() if not network.departures(edge.end))
    network = network.with_place("end", Spot(last.id, last.length - 5.0))
    write_network(tmp_path / "routes.geojson", network)
    return tmp_path


@pytest.fixture
def trip(folder):
    trip = Trip(folder / "routes.geojson", Pose2(1.0, 0.3, 0.1))
    trip.live(0.2)
    return trip


@pytest.mark.slow
def test_a_mission_from_beside_the_path_with_an_edge_closed_under_way(trip):
    goal = trip.begin(place="end")
    trip.live(6.0, lambda: trip.pose.x > 1.5)
    assert trip.said["/route_navigator/status"].state == "DRIVING"
    usual = {feedback.edge for feedback in goal.feedback} - {""}
    plan = trip.navigator.endpoints.call("plan", PlanRoute.Request(place="end"))
    assert plan.success
    middle = plan.edges[1]
    assert trip.navigator.endpoints.call("close_edge", CloseEdge.Request(edge=middle, closed=True)).success
    trip.live(60.0, lambda: goal.result is not None)
    assert (goal.result.success, goal.result.reason) == (True, "")
    assert trip.pose.x == pytest.approx(35.0, abs=0.15)
    assert abs(trip.pose.y) < 0.05
    driven = {feedback.edge for feedback in goal.feedback} - {""}
    assert middle not in driven
    assert usual < driven
    assert goal.result.distance == pytest.approx(34.6, abs=1.0)
    last = trip.said["/route_navigator/status"]
    assert (last.state, list(last.closed_edges), last.last_result, last.map_id) == ("IDLE", [middle], "", "campus")


def test_calls_answer_why_not(trip):
    shell = trip.navigator.endpoints
    assert shell.call("pause").message == "nothing to pause: IDLE"
    assert shell.call("resume").message == "nothing to resume: IDLE"
    trip.navigator.mission.pose = None
    assert "found neither" in shell.call("plan", PlanRoute.Request(place="end")).message
    assert shell.call("plan", PlanRoute.Request(place="end", start="home")).length == pytest.approx(35.0, abs=0.2)
    assert "expected one of end, home" in shell.call("plan", PlanRoute.Request(place="moon", start="home")).message
    assert "edge: expected one of" in shell.call("close_edge", CloseEdge.Request(edge="999", closed=True)).message
    with pytest.raises(ValueError, match="place: expected one of end, home, found 'moon'"):
        trip.begin(place="moon")
    with pytest.raises(ValueError, match="frame_id: expected 'map', found 'odom'"):
        trip.begin(pose=se3_to_pose_stamped(SE3.identity(), 0, "odom"))
    with pytest.raises(ValueError, match=r"pose: expected one within 0.8 m of the network"):
        trip.begin(pose=se3_to_pose_stamped(SE3.from_planar(5, 5, 0), 0, "map"))


def test_a_new_goal_replaces_the_one_under_way_and_a_cancel_stops(trip):
    first = trip.begin(place="end")
    trip.live(5.0)
    second = trip.begin(pose=se3_to_pose_stamped(SE3.from_planar(30.0, 0, 0), 0, "map"))
    assert first.result.reason == "replaced by a new goal"
    trip.live(6.0)
    assert trip.said["/route_navigator/status"].state == "DRIVING"
    trip.cancel(second)
    trip.live(5.0)
    assert (second.result.success, second.result.reason) == (False, "canceled")
    assert trip.said["/cmd_vel"].linear.x == 0.0
    assert 2.0 < trip.pose.x < 29.0


def test_a_vehicle_does_not_drive_in_another_map_than_that_of_the_network(trip):
    trip.live(0.2)
    shown = json.loads(trip.said["/route_navigator/network"].data)
    assert {name for f in shown["features"] for name in f["properties"].get("names", [])} == {"home", "end"}
    trip.begin(place="end")
    message = LocalizationStatus(state="TRACKING", map_id="hall")
    trip.navigator.on_localizer(message)
    trip.navigator.on_tick()
    assert "in map hall, the network is of campus" in trip.navigator.mission.reason
