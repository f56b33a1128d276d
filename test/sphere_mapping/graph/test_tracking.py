from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sphere_mapping.graph import tracking
from sphere_mapping.graph.both_ways import ONE_WAY
from sphere_mapping.graph.motion import DriveMotion, Placed
from sphere_mapping.graph.registration import PreparedSphere
from sphere_mapping.graph.tracking import INNOVATION, SphereTracker, align_unrolled
from sphere_mapping.params import MapperParams
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from worlds.room import sharp_room

PARAMS = MapperParams()
CAMERA = Spherical(256, 128)
ROOM = sharp_room()
PERIOD_NS = 100_000_000
STEP = SE3.exp([0.1, 0.0, 0.0, 0.0, 0.0, 0.03])
POSES = [SE3.identity(), STEP, STEP @ STEP, STEP @ STEP @ STEP]


def prepared(T_room_sphere, number):
    sphere = ROOM.sphere(T_room_sphere, CAMERA, number)
    object.__setattr__(sphere, "stamp_ns", number * PERIOD_NS)
    return PreparedSphere(sphere)


def started(num_placed):
    """A tracker that placed the first spheres where they are; the first is the reference."""
    tracker, graph = SphereTracker(PARAMS), SphereGraph()
    for number in range(num_placed):
        tracker.update(prepared(POSES[number], number), POSES[number], None, None)
        if number == 0:
            node, edge = tracker.make_key(0, graph)
            assert edge is None  # the first sphere was aligned with nothing
            graph.add(node)
    return tracker, graph


@pytest.mark.parametrize("num_placed", [1, 3])
def test_the_next_sphere_is_placed_with_and_without_a_velocity(num_placed, monkeypatch):
    monkeypatch.setattr(tracking, "measure_motion_by_parts", lambda *_: pytest.fail("asked"))
    tracker, graph = started(num_placed)
    found = tracker.align(prepared(POSES[num_placed], num_placed), None, graph)
    assert found.is_converged
    assert found.T_world_camera.distance(POSES[num_placed])[0] < 0.005


def test_where_a_loop_moves_the_map_the_vehicle_goes_along_with_its_key_sphere():
    tracker, _ = started(3)
    before, corrected = SE3.from_planar(1.0, 2.0, 0.5), SE3.from_planar(1.3, 1.9, 0.7)
    tracker.follow(*(SphereGraph([KeySphere(0, 0, pose)]) for pose in (before, corrected)))
    found = corrected.inverse() @ tracker.motion.predict(3 * PERIOD_NS)
    np.testing.assert_allclose(found.matrix, (before.inverse() @ POSES[3]).matrix, atol=1e-12)


def test_a_jump_that_no_vehicle_makes_is_refused_however_well_it_fits():
    tracker, graph = started(2)
    far = POSES[1] @ SE3.exp([0.9, 0, 0, 0, 0, 0])
    assert tracker.align(prepared(far, 2), None, graph).reason == INNOVATION
    late = tracker.align(prepared(far, 20), None, graph)  # in two seconds it could
    assert late.is_converged
    assert late.T_world_camera.distance(far)[0] < 0.01


def test_odometry_allows_what_velocity_does_not_and_forbids_the_rest():
    T_odom_map = SE3.from_planar(3.0, 1.0, -1.0)
    tracker, graph = started(1)
    tracker.update(prepared(POSES[0], 0), POSES[0], T_odom_map, None)
    far = SE3.exp([0.8, 0, 0, 0, 0, 0])
    assert tracker.align(prepared(far, 1), T_odom_map @ far, graph).is_converged
    assert tracker.align(prepared(far, 1), T_odom_map, graph).reason == INNOVATION


def test_a_sphere_whose_way_back_disagrees_is_refused_where_nothing_sharp_was_expected():
    tracker, graph = started(1)
    current = prepared(STEP, 1)
    wrong = np.where(current.sphere.measured, 3.0 * current.sphere.range_m, np.nan).astype(np.float32)
    object.__setattr__(current.sphere, "range_m", wrong)  # its image is right, its range is not
    assert tracker.align(current, None, graph).reason == ONE_WAY


def test_an_edge_that_one_way_measured_alone_is_wide():
    tracker, graph = started(1)
    informations = []
    for scale in (1.0, 3.0):
        current = prepared(STEP, 1)
        alignment = tracker.align(prepared(STEP, 1), None, graph)
        object.__setattr__(current.sphere, "range_m", (scale * current.sphere.range_m).astype(np.float32))
        tracker.update(current, STEP, None, alignment)
        _, edge = tracker.make_key(1, graph)
        tracker.references.pop(0)  # the first one stays the reference
        assert edge.T_a_b.distance(STEP)[0] < 0.005
        informations.append(np.trace(edge.information))
    assert informations[1] < 0.2 * informations[0]


def test_a_key_sphere_is_where_both_ways_put_it_and_goes_on_as_fast():
    """One way alone errs as much in each step, and all along the drive it would add up."""
    tracker, graph = started(2)
    current = prepared(POSES[2], 2)
    alignment = tracker.align(current, None, graph)
    ahead = alignment.T_world_camera @ SE3.exp([0.004, 0.0, 0.0, 0.0, 0.0, 0.0])  # what a one-sided view adds
    tracker.update(current, ahead, None, replace(alignment, T_world_camera=ahead))
    velocity = tracker.motion.velocity()
    node, edge = tracker.make_key(1, graph)
    assert node.T_map_sphere.distance(graph[0].T_map_sphere @ edge.T_a_b)[0] < 1e-9
    assert node.T_map_sphere.distance(POSES[2])[0] < 0.003 < ahead.distance(POSES[2])[0]
    assert node.T_map_sphere is tracker.motion.newest
    np.testing.assert_allclose(tracker.motion.velocity(), velocity, atol=1e-6)


@pytest.mark.parametrize(
    ("is_converged", "num_lost", "is_unrolled"), [(True, 0, True), (True, 1, False), (False, 0, False)]
)
def test_a_key_sphere_is_unrolled_by_the_motion_through_it(is_converged, num_lost, is_unrolled, monkeypatch):
    tracker, graph = started(2)
    graph.add(tracker.make_key(1, graph)[0])
    tracker.motion.num_lost, used = num_lost, []
    after = STEP @ SE3.exp(3.0 * STEP.log())  # it is accelerating
    monkeypatch.setattr(
        tracker, "align_moving", lambda *_: (None, SimpleNamespace(is_converged=is_converged, T_world_camera=after))
    )
    current, sphere = prepared(POSES[2], 2), tracker.last.sphere
    found = tracker.straighten_newest(current, None, None, lambda velocity: used.append(velocity) or sphere, graph)
    assert (found is None) == (not is_converged)
    assert len(used) == is_unrolled
    if is_unrolled:
        np.testing.assert_allclose(used[0], 2.0 * STEP.log() / 0.1, atol=1e-9)
        assert tracker.is_key


def test_a_key_sphere_that_is_unrolled_anew_is_measured_anew():
    tracker, graph = started(2)
    bent = POSES[2] @ SE3.exp([0.02, 0.01, 0.0, 0.0, 0.0, 0.005])  # what a wrong velocity does to an image
    alignment = tracker.align(prepared(bent, 2), None, graph)
    tracker.update(prepared(bent, 2), alignment.T_world_camera, None, alignment)
    node, edge = tracker.make_key(1, graph)
    graph.add(node)
    graph.connect(edge)
    sphere = prepared(POSES[2], 2).sphere
    found = tracker.replace_newest(sphere, graph)
    assert node.T_map_sphere.distance(POSES[2])[0] > 0.015
    assert found[1].sphere is sphere is tracker.last.sphere is tracker.references[0][1].sphere
    (measured,) = found.edges
    for T_map_sphere in (found[1].T_map_sphere, tracker.motion.newest, found[0].T_map_sphere @ measured.T_a_b):
        assert T_map_sphere.distance(POSES[2])[0] < 0.003
    assert tracker.motion.newest.distance(found[1].T_map_sphere)[0] < 1e-9  # the vehicle goes along
    assert tracker.is_key


def test_rounding_does_not_grow_from_key_sphere_to_key_sphere():
    """An inverse is a transpose: what is not quite a rotation would be twice as far from one with each."""
    tracker, graph = started(1)
    bent = SE3.from_parts(np.diag([1.0 + 1e-7, 1.0, 1.0]), np.zeros(3))
    current, first = prepared(STEP, 1), prepared(POSES[0], 0)
    alignment = tracker.align(current, None, graph)
    for number in range(1, 12):
        object.__setattr__(current.sphere, "stamp_ns", number * PERIOD_NS)
        T_map_sphere = graph[number - 1].T_map_sphere @ STEP
        tracker.update(current, T_map_sphere @ bent, None, replace(alignment, T_world_camera=T_map_sphere @ bent))
        tracker.references = [(number - 1, first)]
        node, _ = tracker.make_key(number, graph)
        graph.add(node)
    R = node.T_map_sphere.rotation
    assert np.abs(R.T @ R - np.eye(3)).max() < 1e-5


def test_the_first_motion_of_a_drive_may_be_any():
    tracker, graph = started(1)
    far = SE3.exp([-0.8, 0.6, 0.1, 0.0, 0.05, 1.4])
    found = tracker.align(prepared(far, 1), None, graph)
    assert found.is_converged
    assert found.T_world_camera.distance(far)[0] < 0.02


TRUTH = np.array([0.3, 0.0, 0.1, 0.0, 0.2, 0.5])  # per second
SHARE = 0.4  # of an error of the velocity comes back as an error of the pose


def test_each_pass_takes_part_of_the_error_away():
    """A sphere that a wrong velocity bends is bent anew by what each alignment says of it."""
    prior, used = DriveMotion(), []
    for stamp_ns in (0, PERIOD_NS):
        prior.update(Placed(stamp_ns, SE3.identity()))

    def align(current):
        used.append(current.sphere)
        T = SE3.exp((TRUTH + SHARE * (current.sphere - TRUTH)) * 0.1)
        return SimpleNamespace(is_converged=True, T_world_camera=T)

    align_unrolled(lambda velocity: velocity, 2 * PERIOD_NS, prior, align)
    errors = [np.linalg.norm(velocity - TRUTH) for velocity in used]
    np.testing.assert_allclose(errors, errors[0] * SHARE ** np.arange(3))
