"""The node `path_follower`: poses and a path in, commands out; every pose is answered by a command."""

from __future__ import annotations

from geometry_msgs.msg import Twist, TwistStamped
from sphere_nav_msgs.msg import FollowerStatus, TrackingError
from std_msgs.msg import UInt64

from path_follower.command import Command, FollowerReport
from path_follower.follower import Follower
from path_follower.homing import HomingFollower
from path_follower.modes import FollowerState
from path_follower.params import PathFollowerParams
from path_follower.reasons import StopReason, StopVerdict
from path_follower.ros.intake import Answered, DirectionIntake, PoseIntake, ScanIntake
from path_follower.ros.operator import OperatorCalls
from path_follower.ros.trajectory import TrajectoryIntake
from sphere_nav.ros import qos
from sphere_nav.ros.clocks import MAX_AHEAD_NS, ClockWatch, SimulatedTicks, Times
from sphere_nav.ros.conversions import driving
from sphere_nav.ros.node import ERROR, OK, WARN, ManagedNode
from sphere_nav.ros.run import run

TICK = 0.025  # s of steady time between two looks at the clocks
SILENCE = 0.12  # s without an answer before the ticks command: never between the images of a 10 Hz camera
SOURCE_PERIOD = 0.1  # s between two counts of who publishes the pose
ACKNOWLEDGE = 0.5  # s to wait for all that receive commands to have the last one


class PathFollowerNode(ManagedNode):
    """Converts, asks the follower, converts back. It never moves the vehicle before the call `start`."""

    NAME = "path_follower"
    PARAMS = PathFollowerParams
    params: PathFollowerParams

    def configure(self) -> None:
        """Open topics and services; load the trajectory file where one is set."""
        p = self.params
        self.times = Times(self.now_ns, self.own_ns)
        self.clock_watch = ClockWatch(p.safety.max_clock_pause)
        self.ticks = SimulatedTicks(SILENCE, TICK) if self.shell.is_time_simulated else None
        is_patient = self.ticks is not None and p.source != "homing" and p.safety.is_status_required
        self.answered = Answered(self.times, self.answer, self.catch_up, is_patient=is_patient)
        self.heard_ns, self.told = 0, ""
        profile = qos.COMMAND if self.ticks is None else qos.DEEP  # a simulator waits for each answer: none is lost
        self.cmd_vel = self.add_publisher("cmd_vel", TwistStamped if p.enable_stamped_cmd_vel else Twist, profile)
        ackermann = driving.AckermannDriveStamped
        self.ackermann = ackermann and self.add_publisher("ackermann_cmd", ackermann, qos.COMMAND)
        self.tracking = self.add_publisher("tracking_error", TrackingError)
        self.status = self.add_publisher("~/status", FollowerStatus)
        self.heartbeat, self.beats = self.add_publisher("~/heartbeat", UInt64, qos.COMMAND), 0
        self.trajectories: TrajectoryIntake | None = None
        if p.source == "homing":
            homing = HomingFollower(p)
            self.follower: Follower = homing
            self.intake: PoseIntake | DirectionIntake = DirectionIntake(self.endpoints, p, homing, self.answered)
        else:
            self.follower = Follower(p)
            self.intake = PoseIntake(self.endpoints, p, self.follower, self.answered)
            self.trajectories = TrajectoryIntake(self.endpoints, p, self.follower)
        ScanIntake(self.endpoints, p, self.follower, self.times)
        OperatorCalls(self.endpoints, self.follower)
        self.add_timer(TICK, self.on_tick, is_wall=True)
        self.add_timer(SOURCE_PERIOD, self.on_sources, is_wall=True)

    def activate(self) -> None:
        """Show the trajectory that was loaded at the start."""
        if self.trajectories is not None:
            self.trajectories.show()

    def deactivate(self) -> None:
        """Leave the vehicle with a zero command that everybody has who receives commands."""
        self.follower.stand(StopVerdict(StopReason.OPERATOR))
        self.cmd_vel.publish(self.twist(0.0, 0.0, self.now_ns()))
        if not self.cmd_vel.wait_for_acknowledgement(ACKNOWLEDGE):
            self.log.warning("cmd_vel: the last command, zero, was not acknowledged by all who receive it")

    def tune(self, params: PathFollowerParams) -> None:
        """Drive on with another cruise speed and other limits."""
        self.params = params
        self.follower.tune(params)
        if self.trajectories is not None:
            self.trajectories.tune(params)

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
        self.heard_ns = self.times.now()
        lead = min(max(self.times.lead(stamp), 0), MAX_AHEAD_NS)  # /clock may come later than what it stamps
        if self.ticks is not None:
            self.ticks.restart(self.heard_ns + lead)
        self.publish(self.follower.tick(self.heard_ns + lead), stamp)

    def on_tick(self) -> None:
        """Keep a command alive while nothing else does, and stop when time does."""
        self.beats += 1
        self.heartbeat.publish(UInt64(data=self.beats))
        clock, watch, now = self.now_ns(), self.clock_watch, self.times.now()
        watch.observe(clock, self.steady_ns(), lambda: bool(self.publishers_of("/clock")))
        if watch.is_over and not self.follower.mode.is_at_rest:
            limit = self.params.safety.max_clock_pause
            self.follower.stand(StopVerdict(StopReason.CLOCK_STOPPED, watch.abandoned, limit))
        if watch.is_standing:
            self.publish(self.follower.hold(now, watch.pause), self.stamp_at(clock) - 1)  # it answers nothing
        elif self.ticks is not None:
            self.catch_up(clock)
        elif now - self.heard_ns > 1e9 * SILENCE or self.follower.mode.state is FollowerState.STOPPING:
            self.publish(self.follower.tick(now), self.stamp_at(clock))

    def catch_up(self, now_ns: int) -> None:
        """Where time is simulated, do what was due before a time; it answers nothing that is stamped with this one."""
        for due_ns in self.ticks.take(now_ns) if self.ticks is not None else ():
            self.publish(self.follower.tick(due_ns), self.stamp_at(due_ns))

    def stamp_at(self, clock_ns: int) -> int:
        """Return the stamp of a command that answers nothing new: that of the last answer, unless it is too old."""
        is_based = clock_ns - self.answered.stamp_ns <= 1e9 * self.params.safety.max_pose_silence
        return self.answered.stamp_ns if is_based else clock_ns

    def on_sources(self) -> None:
        """Look who publishes what the vehicle is driven by: more than one cannot be followed."""
        names = self.publishers_of(self.intake.topic)
        self.follower.watch.sources = names
        text = f"{self.intake.topic}: {', '.join(names) or 'no publisher'}"
        self.report("source", ERROR if len(names) > 1 else OK, text)

    # --- commands
    def publish(self, command: Command, stamp: int) -> None:
        """Send a command with the stamp of what it answers, and say what the follower does."""
        frame = self.params.map_frame
        is_idle = command.status.state in (FollowerState.NO_PATH, FollowerState.IDLE)
        if self.heard_ns and not (is_idle and self.params.is_quiet_when_idle):
            self.cmd_vel.publish(self.twist(command.speed, command.yaw_rate, stamp))
            if self.ackermann:
                motion = (command.speed, command.steering_angle)
                self.ackermann.publish(driving.motion_to_ackermann(*motion, stamp, self.params.base_frame))
        if command.tracking is not None:
            self.tracking.publish(driving.tracking_to_message(command.tracking, stamp, frame))
        self.status.publish(driving.follower_status_to_message(command.status, stamp, frame))
        self.tell(command.status)

    def twist(self, speed: float, yaw_rate: float, stamp: int) -> Twist | TwistStamped:
        """Return the message that `cmd_vel` carries."""
        if self.params.enable_stamped_cmd_vel:
            return driving.motion_to_twist_stamped(speed, yaw_rate, stamp, self.params.base_frame)
        return driving.motion_to_twist(speed, yaw_rate)

    def tell(self, status: FollowerReport) -> None:
        """Report to the diagnostics; log every change of state or reason."""
        is_stop = status.state in (FollowerState.STOPPING, FollowerState.STOPPED)
        text = f"{status.state} {status.verdict}".strip()
        self.report("follower", WARN if is_stop else OK, text, progress=status.progress, armed=status.is_armed)
        change = f"{status.state} {status.verdict.reason}"
        if change != self.told:
            (self.log.warning if is_stop else self.log.info)(text)
        self.told = change


def main() -> int:
    """Run the node."""
    return run(PathFollowerNode)
