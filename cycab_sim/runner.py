"""The simulation as a thread of its own: sense, hand out, wait, step; at the pace of commands or of the wall clock.

`LockStep` is the only place where two threads meet: `offer` is called by whoever receives commands, the rest by the
simulation. Where it is strict no wall clock decides anything: time waits for whom it needs, however long.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

from cycab_sim.params import ClockParams
from cycab_sim.sensors.faults import SECOND
from cycab_sim.simulator import START_NS, Simulator
from cycab_sim.vehicle import VehicleCommand

CLOCK_PERIOD = SECOND // 50  # simulated time after which it is told though nothing else is due
MAX_LAG = 0.2  # wall time that is caught up after a slow image, s; more is forgotten
COMMAND_TIMEOUT = round(0.25 * SECOND)  # simulated time without a command after which the car brakes by itself
MAX_LEAD = SECOND  # a stamp further ahead of simulated time comes from another clock
LOOK = 0.1  # s of wall time between two lines about whom time waits for
SETTLE = 1.0  # s of wall time from when all are there to the first image, until each has discovered the others


MEET, ANSWER, PAUSE = "discovery", "the command that answers the last image", "the call resume"  # time waits for


class LockStep:
    """Commands from outside: holds time after an image until a command with its stamp, or a later one, has come.

    Before the first command, and after one has failed to come within the limit, nothing is waited for: the next
    command starts it again. Commands age by their arrival, as in a drive-by-wire, not by what is stamped on them; a
    camera that is slower than the time-out holds them for longer while its images set the pace.

    Where it is strict the vehicle obeys answers alone, the first one to each image, from the instant of the image on.
    """

    def __init__(self, params: ClockParams, camera_period: float = 0.0) -> None:
        self.params = params
        self._hold_ns = round(1.5 * camera_period * SECOND) if params.max_wait > 0.0 or params.is_strict else 0
        self.is_engaged = False
        self.num_missed = 0
        self._command = self._answer = VehicleCommand()
        self._answer_ns = 0
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
            if self.params.is_strict:
                if stamp_ns > self._answer_ns:
                    self._answer, self._answer_ns = command, stamp_ns
            elif stamp_ns >= self._stamp_ns:
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

    def take_answer(self, stamp_ns: int, seconds: float) -> bool:
        """Wait so long for the answer to an image of `stamp_ns`, and obey it from now on; False where it has not come.

        What came before the image, or comes after its first answer, is not obeyed: it depends on the machine.
        """
        with self._arrived:
            if not self._arrived.wait_for(lambda: self._answer_ns >= stamp_ns, seconds):
                return False
            self._command, self._stamp_ns, self._arrived_ns = self._answer, self._answer_ns, stamp_ns
            return True

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


class Runner:
    """Runs a simulator until it is stopped, and again.

    `hand_out(name)` is called for each output that is due, "clock" before the others, time at rest; it returns
    the stamp of the image that a command is to answer, or None.
    Where the lock-step is strict, `find_lack()` says who is missing before time may pass, empty for nobody, and
    `tell(what)` is called again and again while time stands and waits for something.
    Hold `lock` to look at the simulator, or to change it, from another thread.
    """

    def __init__(
        self,
        simulator: Simulator,
        lock_step: LockStep,
        hand_out: Callable[[str], int | None],
        find_lack: Callable[[], str] = str,
        tell: Callable[[str], None] = lambda what: None,
    ) -> None:
        self.simulator = simulator
        self.lock_step = lock_step
        self.lock = threading.Lock()
        self._hand_out, self._find_lack, self._tell = hand_out, find_lack, tell
        self.resumed = threading.Event()
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
        self._meet()
        while not self._stop.is_set():
            self.turn()
            self._keep_pace()

    @property
    def is_stopping(self) -> bool:
        """Whether the present step is the last one."""
        return self._stop.is_set()

    def _meet(self) -> None:
        """Let time stand until all are there that it needs, and know each other."""
        met = time.monotonic()
        while self.simulator.time_ns == START_NS and self.simulator.params.clock.is_strict:
            lack = self._find_lack()
            met = time.monotonic() if lack else met
            self._tell(lack or MEET)
            if self._stop.wait(LOOK) or (not lack and time.monotonic() > met + SETTLE):
                return  # a turn that took longer than that is no reason to begin without them

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
            self._wait(max(stamps))
        with self.lock:
            simulator.step(self._command(), round(simulator.params.clock.step * SECOND))

    def _wait(self, stamp_ns: int) -> None:
        """Wait for the answer to an image; where that is strict for as long as it takes, and for the end of a pause."""
        clock = self.simulator.params.clock
        if not clock.is_strict:
            self.lock_step.wait(stamp_ns)
            return
        while not self.lock_step.take_answer(stamp_ns, LOOK) and not self._stop.is_set():
            self._tell(ANSWER)
        while 0.0 < clock.pause_at * SECOND <= stamp_ns and not self.resumed.wait(LOOK) and not self._stop.is_set():
            self._tell(PAUSE)

    def _command(self) -> VehicleCommand:
        if self.simulator.params.mode == "teach":
            return self.simulator.teach_command()
        return self.lock_step.command(self.simulator.time_ns)

    def _keep_pace(self) -> None:
        """Sleep until wall time has caught up, unless commands set the pace."""
        clock, is_over = self.simulator.params.clock, self.simulator.is_taught
        factor = min(clock.real_time_factor or 1.0, 1.0) if is_over else clock.real_time_factor
        is_waiting = clock.max_wait > 0.0 or clock.is_strict
        if factor <= 0.0 or (is_waiting and self.lock_step.is_engaged):
            self._due_wall = time.monotonic()
            return
        self._due_wall = max(self._due_wall + clock.step / factor, time.monotonic() - MAX_LAG)
        self._stop.wait(max(0.0, self._due_wall - time.monotonic()))
