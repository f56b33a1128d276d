"""READ FIRST. The control loop: what comes in is answered by a command, and time without anything by one, too.

It runs in a process of its own (`loop_process.py`), which hears small messages only: no file, no path, no parameter and
no service is between a pose and its command, or between the emergency stop and its zero. In a replay it is a part of
the node.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import Twist, TwistStamped
from sphere_nav_msgs.msg import FollowerStatus, TrackingError
from std_msgs.msg import UInt64

from path_follower.constants import ACKNOWLEDGE, CYCLE_LOOKS, LOOK_PERIOD, MAX_CLOCK_PAUSE, REPEAT_NS, SILENCE, TICK
from path_follower.follower import Command, Follower
from path_follower.homing import HomingFollower
from path_follower.modes import FollowerReport, FollowerState
from path_follower.params import PathFollowerParams
from path_follower.path import ReferencePath
from path_follower.reasons import FINE, StopReason, describe
from path_follower.ros.intake import Answered, DirectionIntake, PoseIntake, ScanIntake
from path_follower.ros.peers import Peers
from sphere_nav.localization.status import Verdict
from sphere_nav.ros import qos
from sphere_nav.ros.clocks import ClockWatch, SimulatedTicks
from sphere_nav.ros.constants import MAX_AHEAD_NS
from sphere_nav.ros.conversions import driving
from sphere_nav.ros.endpoints import OK, WARN, Endpoints


class ControlLoop:
    """Converts, asks the follower, converts back. It never moves the vehicle before the request `start`."""

    TOPICS = (
        *("cmd_vel", "ackermann_cmd", "tracking_error", "~/status", "~/heartbeat"),
        *("pose", "odometry", "odom", "status", "homing/direction", "homing/status"),
        *("scan", "emergency_stop", "command_guard/status"),
    )

    def __init__(self, endpoints: Endpoints, params: PathFollowerParams) -> None:
        """Open the topics."""
        self.endpoints, self.params, p = endpoints, params, params
        self.clock_watch, self.cycle = ClockWatch(MAX_CLOCK_PAUSE), Cycle()
        self.ticks = SimulatedTicks(SILENCE, TICK) if endpoints.is_time_simulated else None
        is_patient = self.ticks is not None and p.source != "homing" and p.safety.is_status_required
        self.answered = Answered(endpoints, self.answer, self.catch_up, is_patient=is_patient)
        self.heard_ns = 0
        kind = TwistStamped if p.enable_stamped_cmd_vel else Twist
        profile = qos.COMMAND if self.ticks is None else qos.DEEP  # a simulator waits for each answer: none is lost
        self.cmd_vel = endpoints.add_publisher("cmd_vel", kind, profile)
        self.sent, self.sent_ns = kind(), -1  # nothing yet
        ackermann = driving.AckermannDriveStamped
        self.ackermann = ackermann and endpoints.add_publisher("ackermann_cmd", ackermann, qos.COMMAND)
        self.tracking = endpoints.add_publisher("tracking_error", TrackingError)
        self.status = endpoints.add_publisher("~/status", FollowerStatus)
        self.heartbeat, self.beats = endpoints.add_publisher("~/heartbeat", UInt64, qos.COMMAND), 0
        if p.source == "homing":
            homing = HomingFollower(p)
            self.follower: Follower = homing
            self.intake: PoseIntake | DirectionIntake = DirectionIntake(endpoints, p, homing, self.answered)
        else:
            self.follower = Follower(p)
            self.intake = PoseIntake(endpoints, p, self.follower, self.answered)
        self.follower.mode.permission = endpoints.own_ns() // 1_000_000  # of a loop begun anew no older one holds
        self.scans = ScanIntake(endpoints, p, self.follower)
        self.peers = Peers(endpoints, self.intake.topic, lambda pressed: self.follower.emergency(is_pressed=pressed))
        endpoints.add_timer(TICK, self.on_tick, is_wall=True)
        endpoints.add_timer(LOOK_PERIOD, self.peers.look, is_wall=True)

    # --- requests of the front; a text says why not, and is empty where it was done
    def motions(self, path: ReferencePath | None = None) -> dict[str, Callable[[], str | None]]:
        """Return what may be asked of the vehicle, by name; `path`: the one to load."""
        follower = self.follower
        return {
            "start": lambda: self.begin(follower.start),
            "resume": lambda: self.begin(follower.resume),
            "stop": follower.stop,
            "pause": follower.pause,
            "load": lambda: follower.load(path),
            "clear": lambda: follower.load(None),
        }

    def ask(self, name: str, *values: Any) -> Any:
        """Carry out a request by name; before one for motion is answered, all hear what it led to."""
        others: dict[str, Callable[..., Any]] = {
            "is_at_rest": lambda: self.follower.mode.is_at_rest,
            "scan_frame": lambda: self.scans.frame,
            "place_scanner": self.scans.place,
            "tune": self.tune,
            "stand": self.stand,
            "clock_jumped": self.clock_jumped,
        }
        if name in others:
            return others[name](*values)
        answer = self.drive(*values) if name == "drive" else self.motions(*values)[name]()
        self.say(self.follower.report, self.stamp_at(self.endpoints.now_ns()))
        return answer

    def drive(self, name: str, permission: int, path: ReferencePath | None = None) -> tuple[str, int]:
        """Do what was decided under a permission; return why not, and the number of the one now in force."""
        requests = self.motions(path)
        if name not in requests:
            raise ValueError(f"request: expected one of {', '.join(requests)}, found {name!r}")
        refusal = self.follower.under(permission, requests[name], is_stop=name in ("stop", "pause"))
        return refusal, self.follower.mode.permission

    def begin(self, start: Callable[[int], str]) -> str:
        """Drive, beginning with a zero command: what a guard behind this waits for."""
        if self.follower.mode.is_at_rest or self.follower.mode.state is FollowerState.PAUSED:
            verdict = self.peers.begin()
            self.follower.watch.outside = self.peers.judge()
            if verdict is not FINE:
                return describe(verdict)
            self.send(self.twist(0.0, 0.0, self.stamp_at(self.endpoints.now_ns()) - 1))
        return start(self.endpoints.own_ns())

    def tune(self, params: PathFollowerParams) -> None:
        """Drive on with another cruise speed and other limits."""
        self.params = params
        self.follower.tune(params)

    def stand(self) -> None:
        """Leave the vehicle with a zero command that everybody has who receives commands."""
        self.follower.stand(Verdict(StopReason.OPERATOR))
        self.send(self.twist(0.0, 0.0, self.stamp_at(self.endpoints.now_ns()) - 1))
        if not self.cmd_vel.wait_for_acknowledgement(ACKNOWLEDGE):
            self.endpoints.log.warning("cmd_vel: the last command, zero, was not acknowledged by all who receive it")

    def clock_jumped(self) -> None:
        """Forget stamps; brake."""
        self.follower.reset()
        self.answered.forget()
        self.heard_ns = 0
        if self.ticks is not None:
            self.ticks.restart(0)

    # --- time
    def answer(self, stamp: int) -> None:
        """Publish the command that answers a message of this stamp."""
        self.heard_ns = self.endpoints.own_ns()
        lead = min(max(stamp - self.endpoints.now_ns(), 0), MAX_AHEAD_NS)  # /clock may come later than what it stamps
        if self.ticks is not None:
            self.ticks.restart(self.heard_ns + lead)
        self.follower.watch.outside = self.peers.judge()
        self.publish(self.follower.tick(self.heard_ns + lead), stamp)

    def on_tick(self) -> None:
        """Keep a command alive while nothing else does, and stop when time does."""
        self.beats += 1
        self.heartbeat.publish(UInt64(data=self.beats))
        self.cycle.observe(self.endpoints.steady_ns())
        self.follower.watch.outside = self.peers.judge()
        clock, watch, now = self.endpoints.now_ns(), self.clock_watch, self.endpoints.own_ns()
        watch.observe(clock, self.endpoints.steady_ns(), lambda: bool(self.endpoints.publishers_of("/clock")))
        if watch.is_over and not self.follower.mode.is_at_rest:
            self.follower.stand(Verdict(StopReason.CLOCK_STOPPED, watch.abandoned, MAX_CLOCK_PAUSE))
        if watch.is_standing:
            self.publish(self.follower.hold(now, watch.pause), self.stamp_at(clock) - 1)  # it answers nothing
        elif self.ticks is not None:
            self.catch_up(clock)
        elif now - self.heard_ns > 1e9 * SILENCE or self.follower.mode.state is FollowerState.STOPPING:
            self.publish(self.follower.tick(now), self.stamp_at(clock))
        elif self.sent_ns > 0 and self.endpoints.steady_ns() - self.sent_ns > REPEAT_NS:
            self.send(self.sent)

    def catch_up(self, now_ns: int) -> None:
        """Where time is simulated, do what was due before a time; it answers nothing that is stamped with this one.

        After a leap of /clock that is hundreds of looks, behind which no emergency stop waits.
        """
        for due_ns in self.ticks.take(now_ns) if self.ticks is not None else ():
            self.peers.emergency.take()
            self.publish(self.follower.tick(due_ns), self.stamp_at(due_ns))

    def stamp_at(self, clock_ns: int) -> int:
        """Return the stamp of a command that answers nothing new: that of the last answer, unless it is too old."""
        last_ns = self.answered.stamp_ns
        is_based = last_ns > 0 and clock_ns - last_ns <= 1e9 * self.params.safety.max_pose_silence
        return last_ns if is_based else clock_ns

    # --- commands
    def publish(self, command: Command, stamp: int) -> None:
        """Send a command with the stamp of what it answers, and say what the follower does."""
        frame = self.params.map_frame
        is_idle = command.status.state in (FollowerState.NO_PATH, FollowerState.IDLE)
        if self.heard_ns and not (is_idle and self.params.is_quiet_when_idle):
            self.send(self.twist(command.speed, command.yaw_rate, stamp))
            if self.ackermann:
                motion = (command.speed, command.steering_angle)
                self.ackermann.publish(driving.motion_to_ackermann(*motion, stamp, self.params.base_frame))
        if command.tracking is not None:
            self.tracking.publish(driving.tracking_to_message(command.tracking, stamp, frame))
        self.say(command.status, stamp)

    def say(self, status: FollowerReport, stamp: int) -> None:
        """Tell all what the follower does, and why."""
        self.status.publish(driving.follower_status_to_message(status, stamp, self.params.map_frame, self.cycle.worst))
        self.tell(status)

    def send(self, twist: Any) -> None:
        """Publish a command."""
        self.sent, self.sent_ns = twist, self.endpoints.steady_ns()
        self.cmd_vel.publish(twist)

    def twist(self, speed: float, yaw_rate: float, stamp: int) -> Any:
        """Return the message that `cmd_vel` carries."""
        is_stamped, base = self.params.enable_stamped_cmd_vel, self.params.base_frame
        return driving.motion_to_command(speed, yaw_rate, stamp, base, is_stamped=is_stamped)

    def tell(self, status: FollowerReport) -> None:
        """Report to the diagnostics; log every change of state or reason."""
        is_stop = status.state in (FollowerState.STOPPING, FollowerState.STOPPED)
        text = f"{status.state} {describe(status.verdict)}".strip()
        values = {"progress": status.progress, "armed": status.is_armed, "worst_cycle": round(self.cycle.worst, 4)}
        change = f"{status.state} {status.verdict.reason}"
        self.endpoints.tell("follower", WARN if is_stop else OK, text, change, **values)


class Cycle:
    """The longest time between two looks of the loop in the last ten seconds."""

    def __init__(self) -> None:
        self._last_ns = 0
        self._gaps = deque[int](maxlen=CYCLE_LOOKS)  # ns

    def observe(self, now_ns: int) -> None:
        """Note a look."""
        if self._last_ns:
            self._gaps.append(now_ns - self._last_ns)
        self._last_ns = now_ns

    @property
    def worst(self) -> float:
        """In seconds; 0 before the second look."""
        return max(self._gaps, default=0) / 1e9
