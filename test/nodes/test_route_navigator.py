"""The node route_navigator with the node path_follower: missions on an offline bus."""

import json
import math

import numpy as np
import pytest
from geometry_msgs.msg import Twist
from sphere_nav_msgs.action import Navigate
from sphere_nav_msgs.msg import LocalizationStatus
from sphere_nav_msgs.srv import CloseEdge, PlanRoute

from path_follower.path import Pose2
from path_follower.ros.navigator_node import RouteNavigator
from path_follower.ros.node import PathFollowerNode
from path_follower.routes.building import TaughtDrive, build_network
from path_follower.routes.network import Spot
from path_follower.routes.network_file import write_network
from path_follower.vehicle import Motion, drive
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import State, Status
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions import se3_to_pose_stamped, se3_to_pose_with_covariance, status_to_message
from worlds.curves import even_curve

SECOND, STEP = 1_000_000_000, 100_000_000
COVARIANCE = 1e-4 * np.eye(6)
WAY_AROUND = ((5, 0), (4, 1 / 8), (8, -1 / 8), (4, 1 / 8), (19, 0))


class Offered:
    """A goal as a client of the action sees it."""

    def __init__(self, request):
        self.request, self.feedback, self.result = request, [], None

    def publish(self, feedback):
        self.feedback.append(feedback)

    def finish(self, result, *, success):
        self.result = result


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


class Trip:
    def __init__(self, folder):
        self.values = {"network": str(folder / "routes.geojson")}
        self.bus = OfflineBus(start_ns=SECOND)
        self.follower = self.bus.add(PathFollowerNode)
        self.navigator = self.bus.add(RouteNavigator, self.values)
        self.pose, self.said = Pose2(1.0, 0.3, 0.1), {}
        self.live(0.2)

    def begin(self, **goal):
        check, begin, self.cancel = self.navigator.endpoints.actions["navigate"]
        asked = Offered(Navigate.Goal(**goal))
        check(asked.request)
        begin(asked)
        return asked

    def live(self, seconds, until=lambda: False):
        for _ in range(round(seconds * 10)):
            if until():
                return
            now = self.bus.now_ns + STEP
            said = list(self.bus.advance(now))
            status = status_to_message(Status(State.TRACKING, map_id="campus"), now, "map")
            self.bus.publish("/status", status)
            pose = se3_to_pose_with_covariance(SE3.from_planar(*self.pose), COVARIANCE, now, "map")
            self.bus.publish("/pose", pose)
            for record in [*said, *self.bus.settle()]:
                self.said[record.topic] = record.message
            command = self.said.get("/cmd_vel", Twist())
            bend = command.angular.z / command.linear.x if command.linear.x else 0.0
            self.pose = drive(self.pose, Motion(command.linear.x, math.atan(1.2 * bend)), 1.2, STEP / SECOND)


@pytest.fixture
def trip(folder):
    return Trip(folder)


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
