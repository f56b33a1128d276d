"""The simulation as a thread of its own: sense, hand out, wait, step; at the pace of commands or of the wall clock."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from cycab_sim.lock_step import LockStep
from cycab_sim.sensors.faults import SECOND
from cycab_sim.simulator import Simulator
from cycab_sim.vehicle import VehicleCommand

CLOCK_PERIOD = SECOND // 50  # simulated time after which it is told though nothing else is due
MAX_LAG = 0.2  # wall time that is caught up after a slow image, s; more is forgotten


class Runner:
    """Runs a simulator until it is stopped, and again.

    `hand_out(name)` is called for each output that is due, "clock" before the others, time at rest; it returns
    the stamp of the image that a command is to answer, or None.
    Hold `lock` to look at the simulator, or to change it, from another thread.
    """

    def __init__(self, simulator: Simulator, lock_step: LockStep, hand_out: Callable[[str], int | None]) -> None:
        self.simulator = simulator
        self.lock_step = lock_step
        self.lock = threading.Lock()
        self._hand_out = hand_out
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self._due_wall = time.monotonic()
        self._told_ns = 0

    def start(self) -> None:
        """Begin."""
        self._stop.clear()
        self._thread = threading.Thread(target=self._run, name="simulation", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End after the current step."""
        self._stop.set()
        self.lock_step.release()
        if self._thread is not None:
            self._thread.join(timeout=5.0)

    def _run(self) -> None:
        while not self._stop.is_set():
            self.turn()
            self._keep_pace()

    def turn(self) -> None:
        """Do one step: hand out what is due, wait for the command that answers an image, drive."""
        simulator = self.simulator
        with self.lock:
            due = simulator.take_due()
            if due or simulator.time_ns >= self._told_ns + CLOCK_PERIOD:
                due, self._told_ns = ["clock", *due], simulator.time_ns
            images = [self._hand_out(name) for name in due]
        stamps = [stamp for stamp in images if stamp is not None]
        if stamps and simulator.params.mode == "drive":
            self.lock_step.wait(max(stamps))
        with self.lock:
            simulator.step(self._command(), round(simulator.params.clock.step * SECOND))

    def _command(self) -> VehicleCommand:
        if self.simulator.params.mode == "teach":
            return self.simulator.teach_command()
        return self.lock_step.command(self.simulator.time_ns)

    def _keep_pace(self) -> None:
        """Sleep until wall time has caught up, unless commands set the pace."""
        clock, is_over = self.simulator.params.clock, self.simulator.is_taught
        factor = min(clock.real_time_factor or 1.0, 1.0) if is_over else clock.real_time_factor
        if factor <= 0.0 or (clock.max_wait > 0.0 and self.lock_step.is_engaged):
            self._due_wall = time.monotonic()
            return
        self._due_wall = max(self._due_wall + clock.step / factor, time.monotonic() - MAX_LAG)
        self._stop.wait(max(0.0, self._due_wall - time.monotonic()))
