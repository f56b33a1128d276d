from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cycab_sim.params import CameraRigParams, CaptureParams, OdometryParams, SimCameraParams, SimParams, SphereParams
from cycab_sim.simulator import Schedule, Simulator
from cycab_sim.vehicle import VehicleCommand

STEP = 10_000_000


@pytest.fixture(scope="module")
def simulator(small_params):
    return Simulator(small_params)


def run(simulator, steps, command):
    taken = []
    for _ in range(steps):
        for name in simulator.take_due():
            if name != "odom":
                taken.append(simulator.capture(name))
        simulator.step(command, STEP)
    return taken


def test_the_same_run_gives_the_same_bits(small_params):
    results = []
    for _ in range(2):
        simulator = Simulator(replace(small_params, mode="teach"))
        simulator.driver.distance = 0.0
        frames = run(simulator, 80, VehicleCommand(1.0, 0.1))
        results.append((frames, simulator.vehicle.state, simulator.odometry.pose))
    (first, state, pose), (second, state_again, pose_again) = results
    assert state == state_again
    np.testing.assert_array_equal(pose, pose_again)
    assert len(first) == 9  # eight images, and a sphere at the start
    for a, b in zip(first, second, strict=True):
        assert a.stamp_ns == b.stamp_ns
        np.testing.assert_array_equal(a.image, b.image)
        np.testing.assert_array_equal(a.range_m, b.range_m)


def test_the_teaching_drive_ends_where_its_driver_is_done_and_the_car_stands(small_params):
    for mode, is_done, speed, is_over in [
        ("teach", 1, 0.0, 1),
        ("teach", 1, 0.01, 0),
        ("teach", 0, 0, 0),
        ("drive", 1, 0, 0),
    ]:
        simulator = Simulator(replace(small_params, mode=mode))
        simulator.driver = SimpleNamespace(is_done=is_done)
        simulator.teleport(1.0, 0.0, 0.0, speed)
        assert simulator.is_taught == is_over


def test_camera_faults_change_what_is_captured(small_params):
    simulator = Simulator(small_params)
    before = simulator.capture("camera").image.astype(float)
    beam = (simulator.T_world_base.inverse() @ simulator.renderer.torch).apply([[0.0, 0.0, 0.0], [20.0, 0.0, 0.0]])
    np.testing.assert_allclose(beam, [[1.5, 0.0, 0.7], [21.5, 0.0, 0.18]], atol=0.01)  # from the nose to the ground
    faults = simulator.faults
    faults.add("camera", "exposure", 0.5, 0.0, 0.0, simulator.time_ns)
    dark = simulator.capture("camera").image.astype(float)
    assert np.median(dark[before < 200] / before[before < 200]) == pytest.approx(0.5, abs=0.03)
    faults.add("camera", "exposure", 0.0, 0.0, 0.0, simulator.time_ns)
    assert simulator.capture("camera").image.max() <= 6  # black, but for the noise
    faults.clear()
    faults.add("camera", "noise", 20.0, 0.0, 0.0, simulator.time_ns)
    noisy = simulator.capture("camera").image.astype(float)
    middling = (before > 70) & (before < 185)
    assert (noisy - before)[middling].std() == pytest.approx(20.0, rel=0.15)
    faults.clear()
    faults.add("camera", "stuck", 0.0, 0.0, 0.0, simulator.time_ns)
    simulator.teleport(0.0, -0.5, 1.5)
    simulator.step(VehicleCommand(), STEP)
    stuck = simulator.capture("camera")
    np.testing.assert_array_equal(stuck.image, noisy.astype(np.uint8))
    assert stuck.stamp_ns == simulator.time_ns
    faults.clear()
    faults.add("camera", "silent", 0.0, 0.0, 0.0, simulator.time_ns)
    assert "camera" not in [name for _ in range(30) for name in step_and_take(simulator)]


def step_and_take(simulator):
    simulator.step(VehicleCommand(), STEP)
    return simulator.take_due()


def test_actuator_and_wheel_faults(small_params):
    simulator = Simulator(replace(small_params, camera=SimCameraParams(period=0.0)))
    run(simulator, 300, VehicleCommand(1.0, 0.0))
    simulator.faults.add("speed", "stuck", 0.0, 0.0, 1.0, simulator.time_ns)
    run(simulator, 90, VehicleCommand(0.0, 0.0))
    assert simulator.vehicle.state.speed == pytest.approx(1.0, abs=0.01)
    run(simulator, 300, VehicleCommand(1.0, 0.0))
    simulator.faults.add("steering", "bias", 0.1, 0.0, 0.0, simulator.time_ns)
    run(simulator, 300, VehicleCommand(1.0, 0.0))
    assert simulator.vehicle.state.steering == pytest.approx(0.1, abs=1e-3)
    simulator.faults.clear()
    simulator.faults.add("odom", "slip", 0.5, 0.0, 0.0, simulator.time_ns)
    way = simulator.odometry.way
    run(simulator, 300, VehicleCommand(1.0, 0.0))
    assert simulator.odometry.way - way == pytest.approx(6.0, rel=0.02)  # 3 m driven, wheels turned for 6


def test_teleporting_moves_the_car_and_not_the_odometry(simulator):
    pose = simulator.odometry.pose.copy()
    simulator.teleport(12.0, -0.5, 0.1, 0.3)
    assert (simulator.vehicle.state.x, simulator.vehicle.state.speed) == (12.0, 0.3)
    np.testing.assert_array_equal(simulator.odometry.pose, pose)
    with pytest.raises(ValueError, match="teleport: expected finite numbers"):
        simulator.teleport(float("nan"), 0.0, 0.0)


@pytest.fixture(scope="module")
def rig_simulator(small_params):
    rig = CameraRigParams(kind="vertical", size="64,64")
    capture = CaptureParams(when="always")
    return Simulator(replace(small_params, rig=rig, capture=capture, camera=SimCameraParams(period=0.0)))


def test_all_cameras_of_the_rig_see_one_instant(rig_simulator):
    assert "rig" in rig_simulator.take_due()
    frames = rig_simulator.capture_rig()
    assert list(frames) == list(rig_simulator.rig.names)
    assert {frame.stamp_ns for frame in frames.values()} == {rig_simulator.time_ns}
    assert all(frame.image.shape == (64, 64, 3) for frame in frames.values())
    seen = frames["top_left"]
    T_world_camera = rig_simulator.vehicle.state.T_world_base @ rig_simulator.mounts["top_left"].T_base_camera
    ideal, _ = rig_simulator.render(seen.camera, T_world_camera)
    assert np.median(np.abs(ideal.astype(float) - seen.image)) <= 2.0  # its noise


def test_single_cameras_of_the_rig_drop_out_or_freeze(rig_simulator):
    faults, now = rig_simulator.faults, rig_simulator.time_ns
    before = rig_simulator.capture_rig()
    faults.add("top_left", "silent", 0.0, 0.0, 0.0, now)
    faults.add("bottom_front", "stuck", 0.0, 0.0, 0.0, now)
    rig_simulator.teleport(10.0, -0.5, 1.0)
    rig_simulator.step(VehicleCommand(), STEP)
    after = rig_simulator.capture_rig()
    assert set(before) - set(after) == {"top_left"}
    np.testing.assert_array_equal(after["bottom_front"].image, before["bottom_front"].image)
    assert np.mean(after["top_front"].image == before["top_front"].image) < 0.5
    faults.clear()


MS = 1_000_000


def due(schedule, milliseconds, way=0.0):
    found = []
    for t in range(0, milliseconds + 1, 10):
        found += [(t, name) for name in schedule.take(t * MS)]
        schedule.advance(way)
    return found


def test_outputs_come_by_their_period_and_are_counted():
    params = SimParams(camera=SimCameraParams(period=0.1), odometry=OdometryParams(period=0.05))
    schedule = Schedule(params)
    found = due(schedule, 200)
    assert [t for t, name in found if name == "camera"] == [0, 100, 200]
    assert [t for t, name in found if name == "odom"] == [0, 50, 100, 150, 200]
    assert schedule.count == {"odom": 4, "camera": 2, "imu": -1, "scan": -1, "sphere": -1, "rig": -1}


def test_spheres_come_by_the_way_in_the_teaching_drive_only():
    schedule = Schedule(SimParams(mode="teach"))
    assert [t for t, name in due(schedule, 1000, way=0.02) if name == "sphere"] == [0, 250, 500, 750, 1000]
    assert "sphere" not in [name for _, name in due(Schedule(SimParams()), 1000, way=0.02)]
    none = Schedule(SimParams(mode="teach", sphere=SphereParams(width=0)))
    assert "sphere" not in [name for _, name in due(none, 1000, way=0.02)]


def test_the_rig_comes_with_the_spheres_and_is_off_without_cameras():
    rig, capture = CameraRigParams(kind="ring"), CaptureParams(when="always", distance=0.3)
    found = due(Schedule(SimParams(rig=rig, capture=capture)), 1000, way=0.02)
    for kind in ("rig", "sphere"):
        assert [t for t, name in found if name == kind] == [0, 150, 300, 450, 600, 750, 900]
    assert "rig" not in [name for _, name in due(Schedule(SimParams(rig=rig)), 1000, way=0.02)]
    assert "rig" not in [name for _, name in due(Schedule(SimParams(mode="teach")), 500, way=0.02)]
