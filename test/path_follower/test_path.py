"""The reference trajectory: projection with a progress that only moves forward, look-up, segments."""

import math

import numpy as np
import pytest

from path_follower.params import FollowerParams
from path_follower.path import Pose2

SPACING = 0.1

PARAMS = FollowerParams()


def test_projection_finds_the_foot_and_the_side(kit):
    path = kit.make_path([(0, 0), (10, 0)], PARAMS)
    foot = path.advance(Pose2(0.7, 0.3, 0.1), path.begin_of(0), 2.0)
    assert foot.arc_length == pytest.approx(0.7)
    assert foot.cross_track == pytest.approx(0.3)
    assert foot.distance == pytest.approx(0.3)
    assert foot.heading_error == pytest.approx(0.1)


def test_progress_never_goes_back_and_never_jumps(kit):
    path = kit.make_path([(0, 0), (30, 0)], PARAMS)
    foot = path.advance(Pose2(5, 0, 0), path.begin_of(0), 10.0)
    assert path.advance(Pose2(4.5, 0, 0), foot, 2.0).arc_length == foot.arc_length
    assert path.advance(Pose2(20, 0, 0), foot, 2.0).arc_length <= foot.arc_length + 2.0 + SPACING


def test_at_a_crossing_the_foot_stays_on_its_branch(kit):
    radius = 5.0
    eight = kit.course((2 * math.pi * radius, 1 / radius), (2 * math.pi * radius, -1 / radius))
    path = kit.make_path(eight[:, :2], PARAMS, eight[:, 2])
    foot = path.begin_of(0)
    step = 0.4
    for s in np.arange(0.0, path.length, step):
        true = path.at(s, 0)
        foot = path.advance(Pose2(true.x, true.y, true.yaw), foot, 2.0)
        assert foot.arc_length == pytest.approx(s, abs=0.02)  # the polygon of 0.1 m edges


def test_a_start_looks_for_the_heading_and_takes_the_first_of_equal_places(kit):
    loop = kit.course((10, 0), (2 * math.pi * 4, 1 / 4), (10, 0))  # the way out runs over the way in? no: goes on
    path = kit.make_path(loop[:, :2], PARAMS, loop[:, 2])
    assert path.locate(Pose2(9.9, 0.05, 0.0)).arc_length == pytest.approx(9.9, abs=0.02)
    assert path.locate(Pose2(9.9, 0.05, math.pi)).distance > 4.0  # only the far side of the ring heads there
    straight = kit.make_path([(0, 0), (10, 0)], PARAMS)
    assert straight.locate(Pose2(5, 0, math.pi)) is None


def test_passes_further_apart_than_a_quarter_of_a_metre_are_two_places(kit):
    for beside, is_first in [(0.2, True), (0.3, False)]:
        radius = np.interp(np.linspace(0.0, 1.25, 1000), [0.0, 0.9, 1.05, 1.25], [6.0, 6.0, 6.0 - beside, 6.0 - beside])
        angle = np.linspace(0.0, 2.5 * math.pi, 1000)
        points = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        path = kit.make_path(points, PARAMS)
        here = path.at(path.length - 3.0, 0)
        found = path.locate(Pose2(here.x, here.y, here.yaw))
        assert (found.arc_length < 10.0) == is_first


def test_a_start_at_a_flat_crossing_takes_the_pass_that_heads_as_the_vehicle_does(kit):
    """The path crosses itself at 0.6 rad; both passes are within reach, and either may be the closer one."""
    for beside in [0.1, 0.2]:
        bend, ring = 1 / 4, 2 * math.pi - 0.6
        poses = kit.course((20, 0), (ring / bend, bend), (20, 0))
        path = kit.make_path(poses[:, :2], PARAMS, poses[:, 2])
        crossing = 20.0 - 4.0 * math.tan(0.3)  # the straights, lengthened, meet behind the bend's beginning
        for s, side in ((crossing, 1), (crossing, -1), (path.length - crossing, 1), (path.length - crossing, -1)):
            there = path.at(s, 0)
            dx, dy = -side * beside * math.sin(there.yaw), side * beside * math.cos(there.yaw)
            pose = Pose2(there.x + dx, there.y + dy, there.yaw)
            assert path.locate(pose).arc_length == pytest.approx(s, abs=0.05)


def test_a_vehicle_does_not_skip_a_cusp(kit):
    there_and_back = kit.course((5, 0), (-5, 0))
    path = kit.make_path(there_and_back[:, :2], PARAMS, there_and_back[:, 2])
    assert [segment.direction for segment in path.segments] == [1, -1]
    foot = path.begin_of(0)
    for x in np.arange(0, 5.01, 0.2):
        foot = path.advance(Pose2(x, 0, 0), foot, 2.0)
        assert foot.segment == 0
        assert foot.arc_length == pytest.approx(x, abs=0.02)
    second = path.begin_of(1)
    assert second.arc_length == pytest.approx(5.0, abs=0.02)
    assert path.advance(Pose2(4.0, 0, 0), second, 2.0).arc_length == pytest.approx(6.0, abs=0.02)
    assert path.at(6.0, 1).speed < 0
    assert path.at(6.0, 1).yaw == pytest.approx(0.0, abs=1e-9)


def test_a_bend_is_turned_by_speed_times_curvature(kit):
    ring = kit.course((2 * math.pi * 4, 1 / 4))
    path = kit.make_path(ring[:, :2], PARAMS, ring[:, 2])
    point = path.at(8.0, 0)
    assert point.curvature == pytest.approx(0.25, rel=1e-3)
    assert point.yaw_rate == pytest.approx(1.4 * 0.25, rel=1e-3)
