"""Commands from outside against simulated time: the newest one, how old it is, and waiting for the next.

The only place where two threads meet: `offer` is called by whoever receives commands, the rest by the simulation.
"""

from __future__ import annotations

import math
import threading

from cycab_sim.params import ClockParams
from cycab_sim.sensors.faults import SECOND
from cycab_sim.vehicle import VehicleCommand

COMMAND_TIMEOUT = round(0.25 * SECOND)  # simulated time without a command after which the car brakes by itself
MAX_LEAD = SECOND  # a stamp further ahead of simulated time comes from another clock


class LockStep:
    """Holds time after an image until a command with its stamp, or a later one, has come.

    Before the first command, and after one has failed to come within the limit, nothing is waited for: the next
    command starts it again. Commands age by their arrival, as in a drive-by-wire, not by what is stamped on them; a
    camera that is slower than the time-out holds them for longer while its images set the pace.
    """

    def __init__(self, params: ClockParams, camera_period: float = 0.0) -> None:
        self.params = params
        self._hold_ns = round(1.5 * camera_period * SECOND) if params.max_wait > 0.0 else 0
        self.is_engaged = False
        self.num_missed = 0
        self._command = VehicleCommand()
        self._stamp_ns = self._arrived_ns = 0
        self._arrived = threading.Condition()

    def offer(self, command: VehicleCommand, stamp_ns: int, now_ns: int) -> None:
        """Take a command; ValueError refuses one that is not finite or comes from another clock."""
        if not (math.isfinite(command.speed) and math.isfinite(command.yaw_rate)):
            raise ValueError(f"cmd_vel: expected finite numbers, found {command.speed}, {command.yaw_rate}")
        if stamp_ns > now_ns + MAX_LEAD:
            found, now = stamp_ns / SECOND, now_ns / SECOND
            raise ValueError(f"cmd_vel.header.stamp: expected simulated time, now {now:.2f} s, found {found:.2f} s")
        with self._arrived:
            if stamp_ns >= self._stamp_ns:
                self._command, self._stamp_ns, self._arrived_ns = command, stamp_ns, now_ns
            self.is_engaged = True
            self._arrived.notify_all()

    def wait(self, stamp_ns: int) -> bool:
        """Wait for a command of `stamp_ns` or later; False where the limit of wall time has passed."""
        if self.params.max_wait == 0.0:
            return True
        with self._arrived:
            if not self.is_engaged:
                return True
            if self._arrived.wait_for(lambda: self._stamp_ns >= stamp_ns or not self.is_engaged, self.params.max_wait):
                return True
            self.is_engaged = False
            self.num_missed += 1
            return False

    def release(self) -> None:
        """Let a waiting simulation go on, as before its end."""
        with self._arrived:
            self.is_engaged = False
            self._arrived.notify_all()

    def command(self, now_ns: int) -> VehicleCommand:
        """Return the command in force; a stop once none has come for too long."""
        with self._arrived:
            timeout = max(COMMAND_TIMEOUT, self._hold_ns if self.is_engaged else 0)
            return VehicleCommand() if now_ns - self._arrived_ns > timeout else self._command
