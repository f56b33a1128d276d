from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cycab_sim.params import TrafficParams
from cycab_sim.sensors.faults import SECOND
from cycab_sim.simulator import Simulator
from cycab_sim.vehicle import VehicleCommand
from cycab_sim.world.traffic.traffic import Traffic
from cycab_sim.world.worlds import build_world
from sphere_nav.geometry import SE3, Pinhole

pytestmark = pytest.mark.slow

PARAMS = TrafficParams(density="usual")
WIDE = Pinhole(300, 300, 300.0, 300.0, 149.5, 149.5)


@cache
def world():
    return build_world("town", 5)


@pytest.fixture(scope="module")
def traffic():
    return Traffic(world(), PARAMS, 5)


@pytest.fixture(scope="module")
def simulator(small_params):
    return Simulator(replace(small_params, world="town", traffic=PARAMS))


def traffic_now(simulator):
    return simulator.traffic.poses(simulator.time_ns)


def seen_with(simulator, poses, camera, T_world_camera):
    simulator.renderer.move(poses)
    return simulator.renderer.render(camera, T_world_camera, is_gray=True)


def beside_someone(simulator):
    """Pose of a camera 6 m behind a cyclist, looking at him."""
    traffic = simulator.traffic
    poses = traffic_now(simulator)
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
    origin = np.ascontiguousarray(T_world_camera.translation)
    triangles, _ = simulator.renderer._cast(origin, T_world_camera.rotation[:, 2].astype(np.float32)[None])
    assert triangles[0] >= len(simulator.world.mesh.triangles)
    where, away = traffic_now(simulator), traffic_now(simulator)
    away[:, 2, 3] = 1000.0  # who is high up throws his shadow elsewhere
    down = SE3.from_parts(np.diag([1.0, -1.0, -1.0]), [22.0, 17.0, 60.0])
    (shaded, near), (lit, far) = (seen_with(simulator, poses, WIDE, down) for poses in (where, away))
    assert ((shaded < 0.8 * lit) & (near == far)).sum() > 300  # pixels of 0.2 m
    simulator.step(VehicleCommand(), 20 * SECOND)
    later, _ = simulator.render(camera, T_world_camera)
    assert np.mean(np.abs(later.astype(float) - image) > 10.0) > 0.005  # who was 6 m ahead is gone


def test_somebody_stands_in_the_way_where_he_is_put(traffic):
    usual, traffic = len(traffic.actors), Traffic(world(), replace(PARAMS, standing_at=20.0), 5)
    x, y, _, _ = world().path.at(20.0)
    here = traffic._actor_of == len(traffic.actors) - 1
    first, later = (traffic.poses(stamp)[here] for stamp in (SECOND, 500 * SECOND))
    assert np.array_equal(first, later)  # nothing of him moves
    assert np.hypot(*(first[0, :2, 3] - [x, y])) < 0.1  # his body; limbs hang from it
    assert len(traffic.actors) == usual + 1
