"""Which outputs are due at an instant: by time, or by the way that was driven."""

from __future__ import annotations

from cycab_sim.faults import SECOND
from cycab_sim.params import SimParams


class Schedule:
    """Counts time and way since the last output of each kind; `count` is the number of the latest one, from 0."""

    def __init__(self, params: SimParams) -> None:
        sphere = params.sphere
        is_sphere_on = sphere.publish == "always" or (sphere.publish == "teach" and params.mode == "teach")
        if is_sphere_on and sphere.period == 0.0 and sphere.distance == 0.0:
            raise ValueError("sphere.distance, sphere.period: expected one above 0, found both 0")
        self._periods = {"odom": params.odometry.period}
        if params.camera.is_on:
            self._periods["camera"] = params.camera.period
        if is_sphere_on and sphere.period > 0.0:
            self._periods["sphere"] = sphere.period
        self._distance = sphere.distance if is_sphere_on and sphere.period == 0.0 else 0.0
        self._way = self._distance
        self.count = dict.fromkeys(("odom", "camera", "sphere"), -1)

    def advance(self, way: float) -> None:
        """Add the way driven in a step, m."""
        self._way += way

    def take(self, now_ns: int) -> list[str]:
        """Return what is due now and mark it as done."""
        due = [name for name, period in self._periods.items() if self._is_time(name, period, now_ns)]
        if self._distance > 0.0 and self._way >= self._distance - 1e-9:
            due.append("sphere")
            self._way = 0.0
        for name in due:
            self.count[name] += 1
        return due

    def _is_time(self, name: str, period: float, now_ns: int) -> bool:
        return now_ns >= (self.count[name] + 1) * round(period * SECOND)
