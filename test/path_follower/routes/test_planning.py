"""One path of a way, and how a vehicle beside it gets there: by the control law, and a car that is not its model."""

import math

import numpy as np
import pytest

from path_follower.follower import Follower
from path_follower.modes import FollowerState
from path_follower.params import FollowerParams
from path_follower.path import Pose2
from path_follower.routes.building import build_network
from path_follower.routes.network import Curve, Network, RouteEdge, Spot
from path_follower.routes.planning import Leg, Route, make_course, plan

PARAMS = FollowerParams()
REACH, TURNED, ON_PATH_WITHIN = 0.8, math.radians(20.0), 10.0


def beside(curve, s, left, turned):
    at = curve.pose(s)
    return Pose2(at.x - left * math.sin(at.yaw), at.y + left * math.cos(at.yaw), at.yaw + turned)


def path_of(kit, network, route):
    x, y, yaw, speed = make_course(network, route).T
    return kit.make_path(np.stack([x, y], axis=-1), PARAMS, yaw, speed)


@pytest.mark.slow
def test_a_joint_bends_no_more_than_what_was_driven(drive, kit):
    """At the joints of the path that the follower makes of it: continuous in curvature, no speed lost."""
    turn = drive((30, 0), (6 * math.pi / 2, 1 / 6), (20, 0), left=0.1)
    network = build_network([drive((60, 0)), turn])
    goal = next(node for node in network.nodes if not network.departures(node) and network.nodes[node].y > 5)
    route = plan(network, [Spot(next(iter(network.edges)), 1.0)], network.spots_of(goal), cruise=1.4)
    path = path_of(kit, network, route)
    joint = np.abs(path.arc_length - route.ends[0]) < 3.0
    assert np.abs(np.diff(path.curvature[joint])).max() < 0.05
    assert path.max_curvature < 0.2
    assert path.speed[joint].min() == pytest.approx(1.4, abs=0.05)


@pytest.mark.parametrize("direction", [1, -1])
def test_a_car_beside_the_path_is_soon_on_it(drive, kit, direction):
    """Poses with noise, a car with lags: within 10 m, and no further off than full lock leaves it where it heads away.

    In a bend full lock is less: what the bend takes is missing.
    """
    network = build_network([drive((25, 0), (6 * math.pi / 2, 1 / 6), (25, 0))])
    (edge,) = network.edges.values()
    for s, left, turned in ((15.0, REACH, TURNED), (18.0, -REACH, TURNED), (26.0, -0.5, -TURNED), (30.0, REACH, 0.1)):
        away = (1 - math.cos(TURNED)) / (PARAMS.vehicle.max_curvature - (1 / 6 if s > 25 else 0.0))
        pose = beside(edge.curve, s, left, direction * turned)
        route = Route((Leg(edge.id, direction, s, s + 14.0 * direction),))
        follower = Follower(PARAMS, path_of(kit, network, route))
        driven = kit.run(follower, pose, kit.World(position_noise=0.01, yaw_noise=0.002, period=0.1), seconds=40.0)
        assert driven.final.state is FollowerState.FINISHED, driven.final.verdict
        kit.assert_within_limits(driven, PARAMS)
        on = [network.locate(at, 2.0, 1.0)[0] for at in driven.poses]
        assert max(abs(spot.left) for spot in on) < abs(left) + away + 0.05
        assert max(abs(spot.left) for spot in on if direction * (spot.s - s) > ON_PATH_WITHIN) < 0.05


@pytest.mark.parametrize("direction", [1, -1])
def test_a_course_has_the_points_and_the_speeds_of_its_legs(direction):
    """Of two legs on a straight road that was driven faster and faster: forward, or backwards from its end."""
    x = np.linspace(0.0, 20.0, 201)
    edges = {i: RouteEdge(i, i, i + 1, Curve(x + 20 * i, 0 * x, 0 * x, 0.5 + 0.02 * (x + 20 * i)), is_reverse=True)
             for i in (0, 1)}  # fmt: skip
    network = Network({i: Pose2(20.0 * i, 0, 0) for i in range(3)}, edges)
    legs = (Leg(0, 1, 5.0, 20.0), Leg(1, 1, 0.0, 15.0))
    if direction < 0:
        legs = (Leg(1, -1, 15.0, 0.0), Leg(0, -1, 20.0, 5.0))
    route = Route(legs)
    x, y, yaw, speed = make_course(network, route).T
    np.testing.assert_allclose(x, np.linspace(5.0, 35.0, 301)[::direction])
    np.testing.assert_allclose(speed, 0.5 + 0.02 * x)
    assert not y.any()
    assert not yaw.any()
    assert route.ends == pytest.approx([15.0, 30.0])


def test_a_path_of_too_many_points_is_refused(drive):
    network = build_network([drive((60, 0))])
    (edge,) = network.edges.values()
    with pytest.raises(ValueError, match=r"expected at most 1000000 points, found 10\d+: fewer laps"):
        make_course(network, Route(1700 * (Leg(edge.id, 1, 0.0, 60.0),)))
