from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cycab_sim.params import TrafficParams
from cycab_sim.sensors.faults import SECOND
from cycab_sim.simulator import Simulator
from cycab_sim.vehicle import VehicleCommand
from cycab_sim.world.traffic.traffic import AWAY, Traffic
from cycab_sim.world.worlds import build_world
from sphere_nav.geometry import SE3, Pinhole

pytestmark = pytest.mark.slow

PARAMS = TrafficParams(density="usual")
STEP = 100_000_000


@cache
def world():
    return build_world("town", 5)


@pytest.fixture(scope="module")
def traffic():
    return Traffic(world(), PARAMS, 5)


@pytest.fixture(scope="module")
def simulator(small_params):
    return Simulator(replace(small_params, traffic=PARAMS))


def test_all_that_is_asked_for_is_there_and_moves_at_its_pace(traffic):
    assert len(traffic.actors) == 12 + 1 + 6 + 40  # cars, tram, cyclists, pedestrians
    a, b = traffic.poses(20 * SECOND)[:, :2, 3], traffic.poses(21 * SECOND)[:, :2, 3]
    ways = np.linalg.norm(b - a, axis=1)
    assert np.median(ways) == pytest.approx(1.3, rel=0.2)  # most are pedestrians
    assert ways.max() < 5.0 * 1.15 + 0.1


def test_where_they_are_depends_on_the_stamp_and_the_seed_alone(traffic):
    late = traffic.poses(777 * STEP)
    traffic.poses(3 * STEP)
    np.testing.assert_array_equal(traffic.poses(777 * STEP), late)
    np.testing.assert_array_equal(Traffic(world(), PARAMS, 5).poses(777 * STEP), late)
    other = Traffic(world(), replace(PARAMS, seed=1), 5).poses(777 * STEP)
    assert other.shape != late.shape or not np.array_equal(other, late)


def test_nobody_meets_anybody_or_anything(traffic):
    """Places of one actor and another never come closer than both are wide; nothing static stands where they go."""
    widths = np.array([a.figure.half_width for a in traffic.actors])[traffic._actor_of]
    other = traffic._actor_of[:, None] != traffic._actor_of[None]
    for t in range(0, 400, 7):
        places = traffic.poses(t * SECOND)[:, :3, 3]
        distance = np.linalg.norm(places[:, None, :2] - places[None, :, :2], axis=2)
        assert np.all(distance[other] > (widths[:, None] + widths[None])[other])


def test_who_would_be_inside_the_car_is_not_there(traffic):
    T = traffic.poses(0)
    on_it = T[3, :2, 3][None]
    cleared = traffic.poses(0, on_it, 0.6)
    gone = cleared[:, 2, 3] == AWAY
    assert gone[3]
    np.testing.assert_array_equal(np.unique(traffic._actor_of[gone]), [traffic._actor_of[3]])  # whole, and alone
    np.testing.assert_array_equal(cleared[~gone], T[~gone])


def beside_someone(simulator):
    """Pose of a camera 6 m behind a cyclist, looking at him."""
    traffic = simulator.traffic
    poses = traffic.poses(simulator.time_ns)
    cyclists = [p for p, a in enumerate(traffic._actor_of) if traffic.loops[traffic.actors[a].loop].kind == "cycle"]
    x, y = poses[cyclists[0], :2, 3]
    forward = poses[cyclists[0], :3, 0]
    back = -np.array([forward[0], forward[1], 0.0]) / np.hypot(*forward[:2])
    z = -back
    R = np.stack([np.cross([0.0, 0.0, -1.0], z), [0.0, 0.0, -1.0], z], axis=1)
    return SE3.from_parts(R, [x + 6.0 * back[0], y + 6.0 * back[1], 1.0])


def test_traffic_is_seen_and_measured_and_throws_shadows(simulator):
    T_world_camera = beside_someone(simulator)
    camera = Pinhole(120, 120, 120.0, 120.0, 59.5, 59.5)
    image, ranges = simulator.render(camera, T_world_camera)
    assert ranges[40:80, 50:70].min() == pytest.approx(6.0, abs=1.2)
    moving = simulator.renderer._moving
    hits = np.empty(1, np.int32), np.empty(1, np.float32)
    origin = np.ascontiguousarray(T_world_camera.translation)
    simulator.renderer._cast(origin, T_world_camera.rotation[:, 2].astype(np.float32)[None], *hits)
    assert hits[0][0] >= moving.first
    shadows = simulator.renderer._shadows
    assert (shadows.depths < shadows._still).sum() > 500  # texels
    simulator.step(VehicleCommand(), 20 * SECOND)
    later, _ = simulator.render(camera, T_world_camera)
    assert np.mean(np.abs(later.astype(float) - image) > 10.0) > 0.05


def test_the_laser_scanner_sees_traffic(simulator):
    simulator.teleport(-1.0, 14.0, 0.0)  # across the street on which cars and the tram go
    measured = []
    for _ in range(12):
        simulator.step(VehicleCommand(), 50 * STEP)
        measured.append(np.minimum(simulator.scan().ranges, 30.0))
    assert (np.ptp(measured, axis=0) > 0.5).any()  # noise is 0.01 m


def test_somebody_stands_in_the_way_where_he_is_put():
    traffic = Traffic(world(), replace(PARAMS, standing_at=20.0), 5)
    x, y, _, _ = world().path.at(20.0)
    here = traffic._actor_of == len(traffic.actors) - 1
    first, later = (traffic.poses(stamp)[here] for stamp in (SECOND, 500 * SECOND))
    assert np.array_equal(first, later)  # nothing of him moves
    assert np.hypot(*(first[0, :2, 3] - [x, y])) < 0.1  # his body; limbs hang from it
    assert len(traffic.actors) == len(Traffic(world(), PARAMS, 5).actors) + 1
