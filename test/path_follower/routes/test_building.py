"""What drives share is one edge, a branch is where they part or meet in position and heading; curves go on smoothly."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from path_follower.path import wrap
from path_follower.routes.building import TaughtDrive, build_network
from path_follower.routes.network import Curve
from worlds.curves import even_curve

LANE = 0.6

TURN = (6 * math.pi / 2, 1 / 6)


def assert_sound(network, max_bend=0.2):
    """Edges begin and end on their nodes, in position and heading, and no curve bends more than what was driven."""
    for edge in network.edges.values():
        for number, index in ((edge.start, 0), (edge.end, -1)):
            pose = network.nodes[number]
            assert math.hypot(edge.curve.x[index] - pose.x, edge.curve.y[index] - pose.y) < 1e-6
            assert abs(wrap(edge.curve.yaw[index] - pose.yaw)) < 0.01
        assert np.abs(edge.curve.bend).max() < max_bend
        assert np.hypot(np.diff(edge.curve.x), np.diff(edge.curve.y)).max() < 0.2
    used = {number for edge in network.edges.values() for number in (edge.start, edge.end)}
    assert used == set(network.nodes)
    assert not set(network.nodes) & set(network.edges)


def test_where_a_drive_parts_there_is_a_branch(drive):
    network = build_network([drive((60, 0)), drive((30, 0), TURN, (20, 0), left=0.1)])
    assert_sound(network)
    assert len(network.edges) == 3
    branch = next(node for node in network.nodes if len(network.departures(node)) == 2)
    pose = network.nodes[branch]
    assert (pose.x, pose.y) == (pytest.approx(30.0, abs=1.0), pytest.approx(0.0, abs=1e-6))  # on what was there first


def test_where_a_drive_meets_another_there_is_a_branch(drive):
    network = build_network(
        [drive((60, 0)), drive((20, 0), (TURN[0], -TURN[1]), (30, 0), start=(24, -26, math.pi / 2))]
    )
    assert_sound(network)
    meeting = next(node for node in network.nodes if len(network.arrivals(node)) == 2)
    assert network.nodes[meeting].x == pytest.approx(30.0, abs=1.0)


def test_a_crossing_is_no_branch(drive):
    """What matters is the heading: at 180 degrees it is the other direction of the same road."""
    for angle in [20.0, 45.0, 90.0, 180.0]:
        yaw = math.radians(angle)
        start = (30 - 30 * math.cos(yaw), -30 * math.sin(yaw) + 0.1, yaw)
        network = build_network([drive((60, 0)), drive((60, 0), start=start)])
        assert len(network.edges) == 2
        assert len(network.nodes) == 4


def test_a_drive_that_begins_on_a_road_is_a_branch_where_it_heads_alike(drive):
    for angle, edges in [(11.0, 3), (19.0, 2)]:
        network = build_network([drive((60, 0)), drive((40, 0), start=(20.0, 0.0, math.radians(angle)))])
        assert len(network.edges) == edges


def test_drives_that_only_touch_for_a_moment_share_nothing(drive):
    """An arc of 40 m radius that comes to 0.55 m is on the lane for 4 m; one that comes to 0.45 m, for 7 m."""
    for near, edges in ((0.55, 2), (0.45, 5)):
        low = 40 * (1 - math.cos(0.375))
        arc = drive((30, 1 / 40), start=(30 - 40 * math.sin(0.375), low + near, -0.375))
        assert len(build_network([drive((60, 0)), arc]).edges) == edges


def test_lanes_beside_each_other_share_nothing(drive):
    assert len(build_network([drive((60, 0)), drive((60, 0), left=LANE + 0.05)]).edges) == 2
    assert len(build_network([drive((60, 0)), drive((60, 0), left=LANE - 0.05)]).edges) == 1


def test_who_leaves_the_lane_for_a_moment_is_on_it_still(drive):
    for length, edges in [(2.7, 1), (3.3, 4)]:
        x = np.linspace(0.0, 60.0, 601)
        aside = Curve(x, np.where(np.abs(x - 30.0) < length / 2, 0.8, 0.0), 0.0 * x, np.full(601, 1.4))
        assert len(build_network([drive((60, 0)), TaughtDrive(aside)]).edges) == edges


def test_a_short_way_before_or_behind_what_is_shared_is_left_out(drive):
    """The first 0.6 m beyond the road are on its lane still."""
    for beyond, edges in [(3.4, 1), (3.8, 3)]:
        road = drive((60, 0))
        assert len(build_network([road, drive((30, 0), start=(-beyond, 0, 0))]).edges) == edges
        assert len(build_network([road, drive((20 + beyond, 0), start=(40, 0, 0))]).edges) == edges


def test_a_branch_goes_over_to_what_was_driven_within_eight_metres(drive):
    other = drive((30, 0), TURN, (20, 0), left=0.3)
    network = build_network([drive((60, 0)), other])
    branch = next(node for node in network.nodes if len(network.departures(node)) == 2)
    curve = max(network.departures(branch), key=lambda edge: float(edge.curve.y[-1])).curve
    off = []
    for s in (0.0, 4.0, 8.1, 20.0):
        x, y, yaw = curve.pose(s)
        near = int(np.argmin(np.hypot(other.curve.x - x, other.curve.y - y)))
        off.append(math.cos(yaw) * (other.curve.y[near] - y) - math.sin(yaw) * (other.curve.x[near] - x))
    assert off == pytest.approx([0.3, 0.15, 0.0, 0.0], abs=0.02)


def test_a_small_circle_meets_itself_after_one_round(drive):
    """15 m around: less than twice the 10 m after which a drive can meet itself."""
    (edge,) = build_network([drive((45, 1 / 2.4))]).edges.values()
    assert edge.start == edge.end
    assert edge.length == pytest.approx(2 * math.pi * 2.4, abs=0.3)


def test_a_network_begins_at_home_wherever_that_is(drive):
    start = (3.0, -4.0, 2.0)
    network = build_network([drive((60, 0), start=start, left=left) for left in (0.0, 0.1, -0.2)], "campus")
    (edge,) = network.edges.values()
    assert (network.map_id, network.places) == ("campus", {"home": edge.start})
    assert network.nodes[edge.start] == pytest.approx(start)
    network = build_network([drive((60, 0)), drive((40, 0), start=(-40.0, 0.0, 0.0))])  # which ends where home is
    assert sorted(edge.length for edge in network.edges.values()) == pytest.approx([40.0, 60.0], abs=0.1)


def test_an_edge_that_was_driven_backwards_is_reversible(drive):
    network = build_network([drive((60, 0)), drive((20, 0), start=(20, 0, 0), direction=-1)])
    assert_sound(network)
    both = [edge for edge in network.edges.values() if edge.is_reverse]
    assert [edge.length for edge in both] == [pytest.approx(20.0, abs=0.5)]
    assert len(network.edges) == 3
    assert all(edge.is_forward for edge in network.edges.values())
    bend = ((20, 0), TURN, (20, 0))  # on whose inner side the points do not meet those of the road one by one
    (edge,) = build_network([drive(*bend), drive(*bend, left=0.5, direction=-1)]).edges.values()
    assert edge.is_reverse


def test_an_edge_counts_by_its_fastest_drive(drive):
    (edge,) = build_network([drive((60, 0), speed=0.5), drive((60, 0), speed=1.5)]).edges.values()
    assert edge.curve.speed.max() == 1.5


def test_noisy_rounds_of_a_block_and_a_way_through_it_make_one_network(drive, rng):
    """A block of 138 m that is driven three times, and a short cut through its middle, all a few centimetres off."""
    around = [(30, 0), TURN, (20, 0), TURN]
    rounds = drive(*around, *around, *around, *around, *around, *around)
    through = drive((24, 0), (6 * math.pi / 2, 1 / 6), (2 * 6.0, 0), left=0.05)
    noisy = []
    for one in (rounds, through):
        curve = one.curve
        off = gaussian_filter1d(rng.normal(size=(2, len(curve))), 30.0, axis=1) * 0.3
        noisy.append(replace(one, curve=even_curve(curve.x + off[0], curve.y + off[1], curve.yaw, curve.speed)))
    network = build_network(noisy, "block")
    assert_sound(network, max_bend=0.3)
    assert len(network.edges) in (2, 3)
