"""READ FIRST: the world, the car and its sensors as one object that moves from instant to instant.

    simulator = Simulator(SimParams(seed=3))
    while not done:
        for name in simulator.take_due():           # "camera", "sphere", "rig", "odom", "imu", "scan"
            frame = simulator.capture(name)         # or simulator.capture_rig(), .read_imu(), .scan(), .odometry
        simulator.step(command, dt_ns)              # the car drives, time passes

Time is integer nanoseconds and passes in `step` only; the same parameters and commands give the same bits again.

Which outputs are due at an instant: by time, or by the way that was driven.
"""

from __future__ import annotations

import zlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cycab_sim.driver import PurePursuitDriver
from cycab_sim.params import CameraRigParams, SimParams, SphereParams
from cycab_sim.rendering.renderer import Renderer
from cycab_sim.rendering.sky import is_constant, light_at
from cycab_sim.sensors.cameras import Mount, RenderedFrame, expose, forward_camera, roof_sphere, vignette
from cycab_sim.sensors.exposure import Exposure, averaged
from cycab_sim.sensors.faults import SECOND, Faults
from cycab_sim.sensors.imu import Imu, ImuReading
from cycab_sim.sensors.rigs import make_rig, rig_camera_names, rig_mounts
from cycab_sim.sensors.scanner import Scan, Scanner
from cycab_sim.vehicle import Vehicle, VehicleCommand, VehicleState, WheelErrors, WheelOdometry
from cycab_sim.world.paths import arc
from cycab_sim.world.traffic.traffic import Traffic
from cycab_sim.world.worlds import build_world
from sphere_nav.geometry import SE3, Camera

NAMES = ("odom", "imu", "scan", "camera", "sphere", "rig")


class Schedule:
    """Counts time and way since the last output of each kind; `count` is the number of the latest one, from 0."""

    def __init__(self, params: SimParams) -> None:
        self._periods = {"odom": params.odometry.period}
        if params.camera.is_on:
            self._periods["camera"] = params.camera.period
        self._periods |= {name: p.period for name, p in (("imu", params.imu), ("scan", params.scan)) if p.is_on}
        self._distances: dict[str, float] = {}
        self._plan("sphere", params.sphere, params.mode)
        if params.rig.kind != "none":
            self._plan("rig", params.rig, params.mode)
        self._ways = dict(self._distances)  # all are due at the start
        self.count = dict.fromkeys(NAMES, -1)

    def _plan(self, name: str, params: SphereParams | CameraRigParams, mode: str) -> None:
        if params.publish in ("always", mode):
            self._distances[name] = params.distance

    def advance(self, way: float) -> None:
        """Add the way driven in a step, m."""
        for name in self._ways:
            self._ways[name] += way

    def take(self, now_ns: int) -> list[str]:
        """Return what is due now and mark it as done."""
        due = [name for name, period in self._periods.items() if self._is_time(name, period, now_ns)]
        for name, distance in self._distances.items():
            if self._ways[name] >= distance - 1e-9:
                due.append(name)
                self._ways[name] = 0.0
        for name in due:
            self.count[name] += 1
        return due

    def _is_time(self, name: str, period: float, now_ns: int) -> bool:
        return now_ns >= (self.count[name] + 1) * round(period * SECOND)


START_NS = SECOND  # a stamp of 0 means 'no time' in ROS
CAR_POINTS = 8  # along the car, from which traffic keeps off
CAMERA_ROOM = 0.3  # around a camera that is anywhere, m
CAMERAS_AT_ONCE = 2  # of a rig

Levels = NDArray[np.float32]  # of grey or colour, or ranges


class Simulator:
    """A town, a Cycab in it, a camera, a sphere and wheel odometry on the Cycab."""

    def __init__(self, params: SimParams | None = None) -> None:
        self.params = params or SimParams()
        self.world = build_world(self.params.world, self.params.seed, self.params.path)
        traffic = self.params.traffic
        self.traffic = Traffic(self.world, traffic, self.params.seed) if traffic.is_on else None
        bounds = self.world.bounds if self.world.is_wide else None
        self.renderer = Renderer(self.world.mesh, self.params.render, self.params.light, self.traffic, bounds)
        self.path = self.world.path
        self.driver = PurePursuitDriver(self.path, self.params.teach, self.params.noise_seed)
        start = self.path.at(0.0)[:3]
        self.vehicle = Vehicle(VehicleState(*map(float, start)), self.params.vehicle, self.params.actuation)
        self.odometry = WheelOdometry(self.params.odometry.period, self.params.noise_seed)
        self.rig = make_rig(self.params.rig, self.params.seed)
        self.mounts = {mount.name: mount for mount in self._mounts()}
        self.imu = Imu(self.params.imu, self.params.noise_seed)
        self.scanner = Scanner(self.params.noise_seed)
        self.schedule = Schedule(self.params)
        self.faults = Faults(self.rig_names)
        self.time_ns = START_NS
        self._last: dict[str, RenderedFrame] = {}
        self._applied = VehicleCommand()
        self._scene_of: tuple[int, VehicleState] | None = None
        self._exposures = {
            mount.group: Exposure(mount.imaging, self.params.light.gamma, (self.params.seed, 83, zlib.crc32(group)))
            for mount in self.mounts.values()
            for group in [mount.group.encode()]
        }

    def step(self, command: VehicleCommand, dt_ns: int) -> None:
        """Drive for `dt_ns` nanoseconds under a command."""
        command = self._with_actuator_faults(command)
        before, T_world_base = self.vehicle.state, self.T_world_base
        self.vehicle.step(command, dt_ns / SECOND)
        after = self.vehicle.state
        turned, seconds = after.yaw - before.yaw, dt_ns / SECOND
        wrong = self._with_odometry_faults()
        self.odometry.step((before.speed + after.speed) / 2, turned / seconds, seconds, wrong)
        if self.params.imu.is_on:
            self.imu.step(T_world_base, self.T_world_base, seconds)
        self.schedule.advance(abs(before.speed + after.speed) / 2 * seconds)
        self.time_ns += dt_ns

    def take_due(self) -> list[str]:
        """Return the outputs that are due now, each once; outputs withheld by a fault are not among them."""
        due = self.schedule.take(self.time_ns - START_NS)
        return [name for name in due if not self.faults.is_withheld(name, self.schedule.count[name], self.time_ns)]

    def capture(self, name: str, drawn: tuple[Levels, Levels] | None = None) -> RenderedFrame:
        """Return what the camera `name` sees now, noise and faults included; `drawn`: what `_look` has returned."""
        mount, index = self.mounts[name], max(self.schedule.count["rig" if name in self.rig_names else name], 0)
        if self._fault(name, "stuck") is not None and name in self._last:
            return replace(self._last[name], stamp_ns=self.time_ns, index=index)
        levels, range_m = drawn or self._look(mount)
        imaging = mount.imaging
        if imaging.vignetting > 0.0:
            fall = vignette(mount.camera, imaging.vignetting, self.params.light.gamma)
            levels = levels * (fall if mount.is_grey else fall[..., None])
        self._exposures[mount.group].observe(self.time_ns, levels)
        seed = (self.params.noise_seed, index, zlib.crc32(name.encode()))
        noise = float(np.hypot(imaging.noise * mount.noise, self._fault(name, "noise") or 0.0))
        shot_noise = imaging.noise**2 * mount.shot_noise  # a variance
        image = expose(levels, noise, shot_noise, seed, self._fault(name, "bias") or 0.0)
        self._last[name] = RenderedFrame(image, range_m, mount.camera, self.time_ns, index)
        return self._last[name]

    def _look(self, mount: Mount) -> tuple[Levels, Levels]:
        """Return grey levels and ranges that a camera sees now, by its exposure; blurred while its shutter is open."""
        gamma, p = self.params.light.gamma, mount.imaging
        gain = self._exposures[mount.group].gains(self.time_ns)
        exposure = self._fault(mount.name, "exposure")
        if exposure is not None:
            gain = gain * exposure**gamma  # a factor on grey levels

        def draw(offset: float) -> tuple[Levels, Levels]:
            T_world_camera = self._set_scene(offset) @ mount.T_base_camera
            return self.renderer.render(mount.camera, T_world_camera, mount.is_grey, gain)

        levels, range_m = draw(0.0)
        if p.shutter > 0.0:
            levels = averaged(draw, p.shutter, p.shutter_samples, gamma)
        return levels, range_m

    def capture_rig(self) -> dict[str, RenderedFrame]:
        """Return what all cameras of the rig see at this instant, by name; without those withheld by a fault."""
        index = self.schedule.count["rig"]
        names = [name for name in self.rig_names if not self.faults.is_withheld(name, index, self.time_ns)]
        if self.params.imaging.shutter > 0.0:  # a shutter that is open moves the scene
            return {name: self.capture(name) for name in names}
        self._set_scene()
        mounts = [self.mounts[name] for name in names]
        for mount in mounts:
            self._exposures[mount.group].gains(self.time_ns)  # moves on with time, once: not in the threads
        with ThreadPoolExecutor(CAMERAS_AT_ONCE) as pool:  # what one leaves of the cores, another one takes
            drawn = pool.map(self._look, mounts)
            return {name: self.capture(name, levels) for name, levels in zip(names, drawn, strict=True)}

    def read_imu(self) -> ImuReading:
        """Return what the IMU measures now; it follows the car where `imu.is_on`."""
        return self.imu.read(self.T_world_base, max(self.schedule.count["imu"], 0), self.time_ns)

    def scan(self) -> Scan:
        """Return what the laser scanner measures now."""
        self._set_scene()
        return self.scanner.scan(
            self.renderer.measure, self.T_world_base, max(self.schedule.count["scan"], 0), self.time_ns
        )

    @property
    def T_world_base(self) -> SE3:
        """True pose of the car, its wheels on the ground."""
        vehicle = self.params.vehicle
        return self.world.ground.follow(self.vehicle.state.T_world_base, vehicle.wheelbase, vehicle.width)

    def _set_scene(self, offset: float = 0.0) -> SE3:
        """Put light and traffic as they are in `offset` s, nobody inside the car; return where the car is then."""
        p, state = self.params.vehicle, self.vehicle.state
        if offset:
            x, y, yaw = arc((state.x, state.y, state.yaw), state.speed * offset, np.tan(state.steering) / p.wheelbase)
            state = replace(state, x=float(x), y=float(y), yaw=float(yaw))
        T_world_base = self.world.ground.follow(state.T_world_base, p.wheelbase, p.width)
        moment = self.time_ns + round(offset * SECOND), state
        if self._scene_of == moment:
            return T_world_base
        along = np.linspace(-p.rear, p.front, CAR_POINTS)
        middle = T_world_base.apply(np.stack([along, 0.0 * along, 0.0 * along], axis=1))[:, :2]
        self._place(moment[0], middle, p.width / 2)
        self._scene_of = moment
        return T_world_base

    def _place(self, stamp_ns: int, clear: NDArray[np.float64], radius: float) -> None:
        if not is_constant(self.params.light):
            self.renderer.illuminate(light_at(self.params.light, stamp_ns / SECOND, self.params.seed))
        if self.traffic is not None:
            self.renderer.move(self.traffic.poses(stamp_ns, clear, radius))
        self._scene_of = None

    @property
    def rig_names(self) -> tuple[str, ...]:
        """Names of the rig's cameras."""
        return rig_camera_names(self.params.rig.kind)

    def render(
        self, camera: Camera, T_world_camera: SE3, is_grey: bool = False
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Return a perfect view from anywhere, now: image (H, W, 3) RGB or (H, W) grey u1, range (H, W) f32 m.

        Nobody of the traffic stands where the camera is.
        """
        self._place(self.time_ns, T_world_camera.translation[None, :2], CAMERA_ROOM)
        levels, range_m = self.renderer.render(camera, T_world_camera, is_grey)
        return expose(levels, 0.0, 0.0, ()), range_m

    def teleport(self, x: float, y: float, yaw: float, speed: float = 0.0) -> None:
        """Put the car somewhere else; the wheels do not notice."""
        if not np.all(np.isfinite([x, y, yaw, speed])):
            raise ValueError(f"teleport: expected finite numbers, found {x}, {y}, {yaw}, {speed}")
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

    def _mounts(self) -> tuple[Mount, ...]:
        p = self.params
        rig = rig_mounts(p.rig, p.imaging, self.rig)
        return forward_camera(p.camera, p.imaging), roof_sphere(p.sphere), *rig

    def _fault(self, target: str, kind: str) -> float | None:
        return self.faults.magnitude(target, kind, self.time_ns)

    def _with_actuator_faults(self, command: VehicleCommand) -> VehicleCommand:
        is_stuck = self._fault("speed", "stuck") is not None, self._fault("steering", "stuck") is not None
        speed = self._applied.speed if is_stuck[0] else command.speed + (self._fault("speed", "bias") or 0.0)
        yaw_rate = self._applied.yaw_rate if is_stuck[1] else command.yaw_rate
        bias = self._fault("steering", "bias")
        if bias is not None:
            wheelbase = self.params.vehicle.wheelbase
            yaw_rate = speed * np.tan(np.arctan2(wheelbase * yaw_rate, speed) + bias) / wheelbase if speed else 0.0
        self._applied = VehicleCommand(float(speed), float(yaw_rate))
        return self._applied

    def _with_odometry_faults(self) -> WheelErrors | None:
        slip, noise, bias = (self._fault("odom", kind) for kind in ("slip", "noise", "bias"))
        if slip is None and noise is None and bias is None:
            return None
        p = self.odometry.errors
        return replace(
            p, slip=slip or p.slip, speed_noise=noise or p.speed_noise, yaw_rate_bias=bias or p.yaw_rate_bias
        )
