"""Faults on request: what an output or an actuator does wrongly, from when, and for how long."""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from cycab_sim.vehicle import VehicleCommand, WheelErrors

IMAGES = ("silent", "stuck", "noise", "bias", "intermittent", "exposure", "delayed")
MAX_DELAY = 10.0  # s
KINDS = {
    "camera": IMAGES,
    "sphere": IMAGES,
    "odom": ("silent", "stuck", "noise", "bias", "intermittent", "slip", "delayed"),
    "imu": ("silent", "intermittent", "delayed"),
    "scan": ("silent", "intermittent", "delayed"),
    "speed": ("stuck", "bias"),
    "steering": ("stuck", "bias"),
}
SECOND = 1_000_000_000


@dataclass(frozen=True)
class Fault:
    """One fault; times in ns of the simulation, `end_ns` None: until cleared. Magnitude: see SimulationFault.msg."""

    target: str
    kind: str
    magnitude: float
    start_ns: int
    end_ns: int | None

    def is_active(self, now_ns: int) -> bool:
        """Whether it is in force."""
        return self.start_ns <= now_ns and (self.end_ns is None or now_ns < self.end_ns)


class Faults:
    """The faults that were asked for; `cameras` are further outputs with images."""

    def __init__(self, cameras: Iterable[str] = ()) -> None:
        self._faults: list[Fault] = []
        self._kinds = KINDS | dict.fromkeys(cameras, IMAGES)

    def clear(self) -> None:
        """Forget all."""
        self._faults.clear()

    def add(self, target: str, kind: str, magnitude: float, start: float, duration: float, now_ns: int) -> None:
        """Add one; times in s, start 0: now, duration 0: until cleared. ValueError says what is not possible."""
        kinds = self._kinds
        if target not in kinds:
            raise ValueError(f"fault.target: expected one of {', '.join(kinds)}, found {target!r}")
        if kind not in kinds[target]:
            raise ValueError(f"fault.kind: expected one of {', '.join(kinds[target])} for {target}, found {kind!r}")
        if not math.isfinite(magnitude) or (magnitude < 0.0 and kind != "bias"):
            raise ValueError(f"fault.magnitude: expected a finite number, at least 0, found {magnitude}")
        if kind in ("intermittent", "slip") and magnitude >= 1.0 + (kind == "intermittent"):
            raise ValueError(f"fault.magnitude: expected a share below 1, found {magnitude}")
        if kind == "delayed" and magnitude > MAX_DELAY:
            raise ValueError(f"fault.magnitude: expected at most {MAX_DELAY:g} s, found {magnitude}")
        if not (math.isfinite(start) and start >= 0.0 and math.isfinite(duration) and duration >= 0.0):
            raise ValueError(f"fault.start, duration: expected at least 0 s, found {start}, {duration}")
        begin = int(start * SECOND) if start > 0.0 else now_ns
        end = begin + int(duration * SECOND) if duration > 0.0 else None
        self._faults.append(Fault(target, kind, magnitude, begin, end))

    def described(self, now_ns: int) -> list[dict[str, str | float]]:
        """Return those in force or to come, by fields of SimulationFault.msg; start in s, duration 0: until cleared."""
        return [
            {
                "target": fault.target,
                "kind": fault.kind,
                "magnitude": float(fault.magnitude),
                "start": fault.start_ns / SECOND,
                "duration": 0.0 if fault.end_ns is None else (fault.end_ns - fault.start_ns) / SECOND,
            }
            for fault in self._faults
            if fault.end_ns is None or now_ns < fault.end_ns
        ]

    def magnitude(self, target: str, kind: str, now_ns: int) -> float | None:
        """Return the magnitude of the last such fault in force, or None."""
        found = [f.magnitude for f in self._faults if (f.target, f.kind) == (target, kind) and f.is_active(now_ns)]
        return found[-1] if found else None

    def is_withheld(self, target: str, index: int, now_ns: int) -> bool:
        """Whether output number `index` does not come: silent, or dropped by an intermittent fault."""
        if self.magnitude(target, "silent", now_ns) is not None:
            return True
        share = self.magnitude(target, "intermittent", now_ns)
        return share is not None and float(np.random.default_rng([index, zlib.crc32(target.encode())]).random()) < share

    def alter_command(
        self, command: VehicleCommand, applied: VehicleCommand, wheelbase: float, now_ns: int
    ) -> VehicleCommand:
        """Return what the actuators do of a command; `applied` is what they did before, wheelbase in m."""
        is_stuck = [self.magnitude(target, "stuck", now_ns) is not None for target in ("speed", "steering")]
        speed_bias, bias = (self.magnitude(target, "bias", now_ns) for target in ("speed", "steering"))
        speed = applied.speed if is_stuck[0] else command.speed + (speed_bias or 0.0)
        yaw_rate = applied.yaw_rate if is_stuck[1] else command.yaw_rate
        if bias is not None:
            yaw_rate = speed * np.tan(np.arctan2(wheelbase * yaw_rate, speed) + bias) / wheelbase if speed else 0.0
        return VehicleCommand(float(speed), float(yaw_rate))

    def alter_wheels(self, errors: WheelErrors, now_ns: int) -> WheelErrors:
        """Return what the wheels measure wrongly now."""
        slip, noise, bias = (self.magnitude("odom", kind, now_ns) for kind in ("slip", "noise", "bias"))
        return replace(
            errors,
            slip=slip or errors.slip,
            speed_noise=noise or errors.speed_noise,
            yaw_rate_bias=bias or errors.yaw_rate_bias,
        )
