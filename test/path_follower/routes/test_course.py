"""One path of a way, and how a vehicle beside it joins it: by the real control law and a car that is not its model."""

import math
from dataclasses import replace

import numpy as np
import pytest

from path_follower.follower import Follower
from path_follower.modes import FollowerState
from path_follower.params import FollowerParams
from path_follower.path import Pose2
from path_follower.routes.building import TaughtDrive, build_network
from path_follower.routes.course import join_curve, make_course
from path_follower.routes.network import EdgeCurve, Network, RouteEdge, Spot
from path_follower.routes.planning import Leg, Route, plan

JOINED, JOIN_WITHIN, STEP, TURN_SHARE, TURN_RATE = (0.03, math.radians(2.0)), 10.0, 0.1, 0.95, 1.2
LEAD, MAX_GROWTH = 1.0, 1.05

PARAMS = FollowerParams()
VEHICLE = PARAMS.vehicle
REACH, TURNED = 1.0, math.radians(20.0)


def beside(curve, s, left, turned):
    at = curve.pose(s)
    return Pose2(at.x - left * math.sin(at.yaw), at.y + left * math.cos(at.yaw), at.yaw + turned)


def bends_of(poses, direction=1):
    turns = np.diff(np.unwrap(poses[:, 2])) / np.hypot(*np.diff(poses[:, :2], axis=0).T)
    return direction * turns


def course_of(network, route, pose=None):
    """Return the route that is driven, and the columns of its path."""
    route, points = make_course(network, route, pose, VEHICLE)
    return route, points.T


@pytest.mark.slow
def test_a_joint_bends_no_more_than_what_was_driven(drive, kit):
    """At the joints of the path that the follower makes of it: continuous in curvature, no speed lost."""
    turn = drive((30, 0), (6 * math.pi / 2, 1 / 6), (20, 0), left=0.1)
    network = build_network([drive((60, 0)), turn])
    goal = next(node for node in network.nodes if not network.departures(node) and network.nodes[node].y > 5)
    route = plan(network, [Spot(next(iter(network.edges)), 1.0)], network.spots_of(goal), cruise=1.4)
    _, (x, y, yaw, speed) = course_of(network, route)
    path = kit.make_path(np.stack([x, y], axis=-1), PARAMS, yaw, speed)
    joint = np.abs(path.arc_length - route.ends[0]) < 3.0
    assert np.abs(np.diff(path.curvature[joint])).max() < 0.05
    assert path.max_curvature < 0.2
    assert path.speed[joint].min() == pytest.approx(1.4, abs=0.05)


@pytest.mark.parametrize(("direction", "rear_steering"), [(1, 0.0), (-1, 0.8)])
def test_a_join_is_feasible_and_short(drive, rng, direction, rear_steering):
    """From 80 starts: within the car's curvature, on the path within 10 m, no further off than full lock allows."""
    (edge,) = build_network([drive((60, 0))]).edges.values()
    c, order = edge.curve, slice(None, None, direction)
    curve = EdgeCurve(c.x[order], c.y[order], c.yaw[order], c.speed[order])
    vehicle = replace(VEHICLE, rear_steering=rear_steering)
    limit = (1.0 + rear_steering) * math.tan(TURN_SHARE * VEHICLE.max_steering_angle) / VEHICLE.wheelbase
    bends = []
    for left, turned in rng.uniform((-REACH, -TURNED), (REACH, TURNED), (80, 2)):
        pose = beside(curve, 0.0, left, turned)
        poses, s = join_curve(curve, direction, pose, vehicle, JOIN_WITHIN)
        assert tuple(poses[0]) == pytest.approx(pose)
        assert s <= JOIN_WITHIN
        bends += [np.abs(bends_of(poses)).max(initial=0.0)]
        np.testing.assert_allclose(np.hypot(*np.diff(poses[:, :2], axis=0).T), STEP, rtol=1e-2)
        assert abs(poses[-1, 1]) <= JOINED[0]
        assert abs(poses[-1, 2]) <= JOINED[1]
        turn, is_away = (1 - math.cos(turned)) / limit, left * turned * direction > 0
        assert np.abs(poses[:, 1]).max() <= 0.05 + (abs(left) + turn if is_away else max(abs(left), turn - abs(left)))
    assert max(bends) == pytest.approx(limit, rel=1e-3)


def test_a_join_turns_the_wheel_no_faster_than_it_can(drive):
    """Where the path begins to bend before it is reached."""
    (edge,) = build_network([drive((2, 0), (8, 1 / 4))]).edges.values()
    poses, _ = join_curve(edge.curve, 1, Pose2(0.0, 1.0, 0.0), VEHICLE, JOIN_WITHIN)
    wheel = np.arctan(bends_of(poses) * VEHICLE.wheelbase)
    assert np.abs(np.diff(wheel)).max() == pytest.approx(TURN_RATE * STEP, rel=1e-3)


@pytest.mark.parametrize("direction", [1, -1])
def test_a_course_begins_behind_a_vehicle_that_joins_on_the_circle_that_it_drives(drive, direction):
    network = build_network([drive((30, 0)), TaughtDrive(drive((30, 0)).curve, -1)])
    (edge,) = network.edges.values()
    first, last = (5.0, 25.0)[::direction]
    pose = beside(edge.curve, first, 0.5, direction * 0.25)
    route, columns = course_of(network, Route((Leg(edge.id, direction, first, last),), 0.0), pose)
    count = round(LEAD / STEP)
    assert route.lead == pytest.approx(LEAD)
    points = columns[:3].T
    assert points[count] == pytest.approx(pose)
    bends = bends_of(points[: count + 2], direction)
    np.testing.assert_allclose(bends, bends[-1], rtol=1e-6)
    assert bends[-1] < -0.35  # 1/m: as far as the wheel may, to the path
    steps = np.hypot(*np.diff(points[:, :2], axis=0).T)
    assert route.length == pytest.approx(steps.sum() - LEAD, abs=0.01)


def test_full_lock_is_taken_only_where_the_offset_would_grow(drive):
    (edge,) = build_network([drive((60, 0))]).edges.values()
    firm, gentle = (
        join_curve(edge.curve, 1, beside(edge.curve, 0.0, 0.1, turned), VEHICLE, JOIN_WITHIN)[0]
        for turned in (0.1, 0.02)
    )
    limit = math.tan(TURN_SHARE * VEHICLE.max_steering_angle) / VEHICLE.wheelbase
    assert bends_of(firm)[0] == pytest.approx(-limit, rel=1e-4)  # by the chord, which is shorter than the arc
    assert np.abs(firm[:, 1]).max() < 0.1 + (1 - math.cos(0.1)) / limit + 0.002
    assert -0.15 < bends_of(gentle)[0] < 0.0
    assert np.abs(gentle[:, 1]).max() < MAX_GROWTH * 0.1


def test_a_car_drives_onto_the_path(drive, kit):
    """Poses with noise, a car with lags: as planned within 5 cm."""
    network = build_network([drive((25, 0), (6 * math.pi / 2, 1 / 6), (25, 0))])
    (edge,) = network.edges.values()
    for s, left, turned in ((3.0, REACH, TURNED), (18.0, -0.8, TURNED), (26.0, -0.5, -TURNED)):
        pose = beside(edge.curve, s, left, turned)
        route = plan(network, network.locate(pose, 1.05, 0.4), [Spot(edge.id, s + 14.0)], cruise=1.4)
        _, (x, y, yaw, speed) = course_of(network, route, pose)
        follower = Follower(PARAMS, kit.make_path(np.stack([x, y], axis=-1), PARAMS, yaw, speed))
        driven = kit.run(follower, pose, kit.World(position_noise=0.01, yaw_noise=0.002, period=0.1), seconds=40.0)
        assert driven.final.state is FollowerState.FINISHED, driven.final.verdict
        kit.assert_within_limits(driven, PARAMS)
        assert driven.worst < 0.05  # beside what was planned, which test_a_join_is_feasible_and_short judges
        on = [network.locate(at, 2.0, 1.0)[0] for at in driven.poses]
        late = [abs(spot.left) for spot in on if spot.s > s + JOIN_WITHIN]
        assert max(late) < 0.05


@pytest.mark.parametrize("direction", [1, -1])
def test_a_course_from_beside_has_the_speeds_of_where_it_is(direction):
    """Of two legs on a straight road that was driven faster and faster: forward, or backwards from its end."""
    x = np.linspace(0.0, 20.0, 201)
    edges = {i: RouteEdge(i, i, i + 1, EdgeCurve(x + 20 * i, 0 * x, 0 * x, 0.5 + 0.02 * (x + 20 * i)), is_reverse=True)
             for i in (0, 1)}  # fmt: skip
    network = Network({i: Pose2(20.0 * i, 0, 0) for i in range(3)}, edges)
    legs = (Leg(0, 1, 5.0, 20.0), Leg(1, 1, 0.0, 15.0))
    if direction < 0:
        legs = (Leg(1, -1, 15.0, 0.0), Leg(0, -1, 20.0, 5.0))
    start = 5.0 if direction > 0 else 35.0
    route, (x, y, yaw, speed) = course_of(network, Route(legs, 0.0), Pose2(start, 0.6, 0.1))
    own = slice(round(route.lead / STEP), None)  # behind the lead, whose speed is that of the vehicle's place
    np.testing.assert_allclose(speed[own], 0.5 + 0.02 * x[own], atol=0.005)
    assert (speed[: own.start] == speed[own.start]).all()
    assert (x[own][0], y[own][0], yaw[own][0]) == pytest.approx((start, 0.6, 0.1))
    assert (np.diff(x) * direction > 0).all()
    assert (y[-1], yaw[-1]) == (0.0, 0.0)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])[own] - route.lead
    assert way[-1] == pytest.approx(route.length, abs=1e-3)  # chords of the lead's circle
    assert np.interp(route.ends[0], way, x[own]) == pytest.approx(20.0, abs=1e-3)
    turning = [legs[0], replace(legs[0], direction=-direction, first=legs[0].last, last=legs[0].first)]
    short = Route((replace(turning[0], last=turning[0].first + 1.2 * direction), *turning[1:]), 0.0)
    with pytest.raises(ValueError, match=r"beside it after 1\.2 m"):  # it has to be on the path before it turns back
        make_course(network, short, Pose2(start, 0.6, 0.1), VEHICLE)


def test_a_path_that_cannot_be_joined_or_is_too_long_is_refused(drive):
    network = build_network([drive((60, 0))])
    (edge,) = network.edges.values()
    with pytest.raises(ValueError, match=r"expected a vehicle that can drive onto the path, found 0\.\d+ m"):
        make_course(network, Route((Leg(edge.id, 1, 5.0, 6.0),), 0.0), beside(edge.curve, 5.0, 1.0, 0.0), VEHICLE)
    on, _ = make_course(network, Route((Leg(edge.id, 1, 5.0, 6.0),), 0.0), edge.curve.pose(5.0), VEHICLE)
    assert on.length == pytest.approx(1.0)
    with pytest.raises(ValueError, match=r"expected at most 1000000 points, found 10\d+: fewer laps"):
        make_course(network, Route(1700 * (Leg(edge.id, 1, 0.0, 60.0),), 0.0), None, VEHICLE)
