"""READ FIRST: the world, the car and its sensors as one object that moves from instant to instant.

    simulator = Simulator(SimParams(seed=3))
    while not done:
        for name in simulator.take_due():           # "camera", "sphere", "rig", "odom", "imu", "scan"
            frame = simulator.capture(name)         # or simulator.capture_rig(), .read_imu(), .scan(), .odometry
        simulator.step(command, dt_ns)              # the car drives, time passes

Time is integer nanoseconds and passes in `step` only; the same parameters and commands give the same bits again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cycab_sim.driver import PurePursuitDriver
from cycab_sim.params import SimParams, in_condition
from cycab_sim.rendering.renderer import Renderer
from cycab_sim.rendering.sky import light_at
from cycab_sim.sensors.cameras import forward_camera, make_rig, rig_camera_names, rig_mounts, roof_sphere
from cycab_sim.sensors.faults import SECOND, Faults
from cycab_sim.sensors.imaging import CameraArray, RenderedFrame, expose
from cycab_sim.sensors.imu import Imu, ImuReading
from cycab_sim.sensors.scanner import Scanner
from cycab_sim.vehicle import Vehicle, VehicleCommand, VehicleState, WheelOdometry
from cycab_sim.world.paths import Path, arc
from cycab_sim.world.traffic.traffic import Traffic
from cycab_sim.world.worlds import build_world
from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.arrays import Array, Bytes, Floats

MAX_PLACE, MAX_SPEED = 1e6, 100.0  # m from the origin, and m/s, that a car is put to
NAMES = ("odom", "imu", "scan", "camera", "sphere", "rig")
START_NS = SECOND  # a stamp of 0 means 'no time' in ROS
CAR_POINTS = 8  # along the car, from which traffic keeps off
CAMERA_ROOM = 0.3  # around a camera that is anywhere, m
T_BASE_TORCH = SE3.from_angles(0.0, float(np.radians(1.5)), 0.0, [1.5, 0.0, 0.7])


class Simulator:
    """A world, a Cycab in it, and the sensors on the Cycab."""

    def __init__(self, params: SimParams | None = None, path: Path | None = None) -> None:
        """`path`: to start on and to teach, of which traffic keeps off, in place of the world's own."""
        self.params = p = in_condition(params or SimParams())
        world = build_world(p.world, p.seed, p.path, p.season)
        self.world = replace(world, path=path or world.path)
        self.traffic = Traffic(self.world, p.traffic, p.seed) if p.traffic.density != "none" else None
        self.renderer = Renderer(self.world.mesh, p.render, p.light, self.traffic, world.bounds, p.season)
        self.path = self.world.path
        self.driver = PurePursuitDriver(self.path, p.teach, p.noise_seed)
        x, y, yaw = map(float, self.path.at(0.0)[:3])
        self.vehicle = Vehicle(VehicleState(x, y, yaw), p.vehicle, p.actuation)
        self.rig_names = rig_camera_names(p.rig.kind)
        self.faults = Faults(self.rig_names)
        self.rig = make_rig(p.rig, p.seed)
        mounts = forward_camera(p.camera, p.imaging), *roof_sphere(p.sphere), *rig_mounts(p.rig, p.imaging, self.rig)
        self.cameras = CameraArray(mounts, self.faults, self.renderer, self._set_scene, (p.seed, p.noise_seed))
        self.mounts = self.cameras.mounts
        self.odometry = WheelOdometry(p.odometry.period, p.noise_seed)
        self.imu = Imu(p.imu, p.noise_seed)
        self.scanner = Scanner(p.noise_seed)
        self.schedule = Schedule(p)
        self.time_ns = START_NS
        self._applied = VehicleCommand()
        self._scene_of: tuple[int, VehicleState] | None = None

    # --- time
    def step(self, command: VehicleCommand, dt_ns: int) -> None:
        """Drive for `dt_ns` nanoseconds under a command."""
        p, now, seconds = self.params, self.time_ns, dt_ns / SECOND
        self._applied = self.faults.alter_command(command, self._applied, p.vehicle.wheelbase, now)
        before, T_world_base = self.vehicle.state, self.T_world_base
        self.vehicle.step(self._applied, seconds)
        after = self.vehicle.state
        speed, yaw_rate = (before.speed + after.speed) / 2, (after.yaw - before.yaw) / seconds
        self.odometry.step(speed, yaw_rate, seconds, self.faults.alter_wheels(self.odometry.errors, now))
        if p.imu.is_on:
            self.imu.step(T_world_base, self.T_world_base, seconds)
        self.schedule.advance(abs(before.speed + after.speed) / 2 * seconds)
        self.time_ns += dt_ns

    def take_due(self) -> list[str]:
        """Return the outputs that are due now, each once; outputs withheld by a fault are not among them."""
        due = self.schedule.take(self.time_ns - START_NS)
        return [name for name in due if not self.faults.is_withheld(name, self._number(name), self.time_ns)]

    # --- what the sensors measure now
    def capture(self, name: str) -> RenderedFrame:
        """Return what the camera `name` sees now, noise and faults included."""
        return self.cameras.capture(name, self._number("rig" if name in self.rig_names else name), self.time_ns)

    def capture_rig(self) -> dict[str, RenderedFrame]:
        """Return what all cameras of the rig see now, by name; without those withheld by a fault."""
        index, now = self._number("rig"), self.time_ns
        names = [name for name in self.rig_names if not self.faults.is_withheld(name, index, now)]
        return self.cameras.capture_together(names, index, now)

    def read_imu(self) -> ImuReading:
        """Return what the IMU measures now; it follows the car where `imu.is_on`."""
        return self.imu.read(self.T_world_base, self._number("imu"))

    def scan(self) -> Floats:
        """Return the ranges (N,) m that the laser scanner measures now."""
        return self.scanner.scan(self.renderer.measure, self._set_scene(), self._number("scan"))

    def _number(self, name: str) -> int:
        """Return the number of the latest output of a name, 0 before the first."""
        return max(self.schedule.count[name], 0)

    # --- the car
    @property
    def T_world_base(self) -> SE3:
        """True pose of the car, its wheels on the ground."""
        return self._on_ground(self.vehicle.state)

    def teleport(self, x: float, y: float, yaw: float, speed: float = 0.0) -> None:
        """Put the car somewhere else; the wheels do not notice."""
        if not np.all(np.isfinite([x, y, yaw, speed])):
            raise ValueError(f"teleport: expected finite numbers, found {x}, {y}, {yaw}, {speed}")
        if max(abs(x), abs(y)) > MAX_PLACE or abs(speed) > MAX_SPEED:  # the car's motion would not be finite
            expected = f"at most {MAX_PLACE:g} m and {MAX_SPEED:g} m/s"
            raise ValueError(f"teleport: expected {expected}, found {x:g}, {y:g} and {speed:g}")
        self.vehicle.state = VehicleState(x, y, yaw, speed, 0.0)
        self.imu.forget()

    def teach_command(self) -> VehicleCommand:
        """Return what the driver of the teaching drive does now: nothing at first, and at the end of the path."""
        if self.time_ns - START_NS < self.params.teach.delay * SECOND:
            return VehicleCommand()
        return self.driver.command(self.vehicle.state)

    @property
    def is_taught(self) -> bool:
        """Whether the teaching drive has ended and the car stands."""
        return self.params.mode == "teach" and self.driver.is_done and abs(self.vehicle.state.speed) < 1e-3

    # --- the world around it
    def render(self, camera: Camera, T_world_camera: SE3, is_gray: bool = False) -> tuple[Bytes, Floats]:
        """Return a perfect view from anywhere, now: image (H, W, 3) RGB or (H, W) grey u1, range (H, W) f32 m.

        Nobody of the traffic stands where the camera is.
        """
        self._light_and_move(self.time_ns, T_world_camera.translation[None, :2], CAMERA_ROOM)
        self.renderer.torch = self.T_world_base @ T_BASE_TORCH
        self._scene_of = None
        levels, range_m = self.renderer.render(camera, T_world_camera, is_gray)
        return expose(levels, 0.0, 0.0, ()), range_m

    def _set_scene(self, offset: float = 0.0) -> SE3:
        """Put light and traffic as they are in `offset` s, nobody inside the car; return where the car is then."""
        p, state = self.params.vehicle, self.vehicle.state
        if offset:
            x, y, yaw = arc((state.x, state.y, state.yaw), state.speed * offset, np.tan(state.steering) / p.wheelbase)
            state = replace(state, x=float(x), y=float(y), yaw=float(yaw))
        T_world_base = self._on_ground(state)
        moment = self.time_ns + round(offset * SECOND), state
        if self._scene_of != moment:
            along = np.linspace(-p.rear, p.front, CAR_POINTS)
            middle = T_world_base.apply(np.stack([along, 0.0 * along, 0.0 * along], axis=1))[:, :2]
            self._light_and_move(moment[0], middle, p.width / 2)
            self.renderer.torch = T_world_base @ T_BASE_TORCH
            self._scene_of = moment
        return T_world_base

    def _light_and_move(self, stamp_ns: int, clear: Array, radius: float) -> None:
        """Put light and traffic as they are at an instant, nobody within `radius` m of the points `clear` (N, 2)."""
        self.renderer.light = light_at(self.params.light, stamp_ns / SECOND, self.params.seed)
        if self.traffic is not None:
            self.renderer.move(self.traffic.poses(stamp_ns, clear, radius))

    def _on_ground(self, state: VehicleState) -> SE3:
        p = self.params.vehicle
        return self.world.ground.follow(state.T_world_base, p.wheelbase, p.width)


class Schedule:
    """Which outputs are due, by time or by the way driven; `count` is the number of the latest of each kind, from 0."""

    def __init__(self, params: SimParams) -> None:
        self._periods = {"odom": params.odometry.period, "camera": params.camera.period}
        self._periods |= {name: p.period for name, p in (("imu", params.imu), ("scan", params.scan)) if p.is_on}
        has = {"sphere": params.sphere.width > 0, "rig": params.rig.kind != "none"}
        names = [name for name in has if has[name] and params.capture.when in ("always", params.mode)]
        self._distance = params.capture.distance
        self._ways = dict.fromkeys(names, self._distance)  # all are due at the start
        self.count = dict.fromkeys(NAMES, -1)

    def advance(self, way: float) -> None:
        """Add the way driven in a step, m."""
        for name in self._ways:
            self._ways[name] += way

    def take(self, now_ns: int) -> list[str]:
        """Return what is due now and mark it as done."""
        due = [
            name
            for name, period in self._periods.items()
            if period and now_ns >= (self.count[name] + 1) * round(period * SECOND)
        ]
        for name, way in self._ways.items():
            if way >= self._distance - 1e-9:
                due.append(name)
                self._ways[name] = 0.0
        for name in due:
            self.count[name] += 1
        return due
