"""Which outputs are due at an instant: by time, or by the way that was driven."""

from __future__ import annotations

from cycab_sim.faults import SECOND
from cycab_sim.params import RigParams, SimParams, SphereParams

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

    def _plan(self, name: str, params: SphereParams | RigParams, mode: str) -> None:
        if not (params.publish == "always" or (params.publish == "teach" and mode == "teach")):
            return
        if params.period > 0.0:
            self._periods[name] = params.period
        elif params.distance > 0.0:
            self._distances[name] = params.distance
        else:
            raise ValueError(f"{name}.distance, {name}.period: expected one above 0, found both 0")

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
