"""The node `path_follower`: poses and a path in, commands out; every pose is answered by a command."""

from __future__ import annotations

from geometry_msgs.msg import Twist, TwistStamped
from sphere_nav_msgs.msg import FollowerStatus, TrackingError

from node_kit import qos
from node_kit.conversions import driving
from node_kit.node import OK, WARN, ManagedNode
from node_kit.run import run
from path_follower.command import Command, Status
from path_follower.follower import Follower
from path_follower.homing import HomingFollower
from path_follower.intake_node import Intake
from path_follower.modes import State
from path_follower.operator_node import OperatorCalls
from path_follower.params import PathFollowerParams
from path_follower.trajectory_node import TrajectoryIntake

SILENT_PERIODS = 2.4  # without a pose before the timer takes over: never between the images of a 10 Hz camera


class PathFollowerNode(ManagedNode):
    """Converts, asks the follower, converts back. It never moves the vehicle before the call `start`."""

    NAME = "path_follower"
    PARAMS = PathFollowerParams
    params: PathFollowerParams

    def configure(self) -> None:
        """Open topics and services; load the trajectory file where one is set."""
        p, is_homing = self.params, self.params.source == "homing"
        self.follower = HomingFollower(p, p.homing) if is_homing else Follower(p)
        self.answered_ns, self.heard_ns, self.told = 0, 0, ""
        self.cmd_vel = self.add_publisher("cmd_vel", TwistStamped if p.enable_stamped_cmd_vel else Twist, qos.COMMAND)
        has_ackermann = driving.AckermannDriveStamped is not None
        self.ackermann = has_ackermann and self.add_publisher(
            "ackermann_cmd", driving.AckermannDriveStamped, qos.COMMAND
        )
        self.tracking = self.add_publisher("tracking_error", TrackingError)
        self.status = self.add_publisher("path_follower/status", FollowerStatus)
        self.intake = Intake(self)
        self.add_timer(p.period, self.on_tick)
        self.trajectories = None if is_homing else TrajectoryIntake(self, self.follower)
        OperatorCalls(self, self.follower)

    def activate(self) -> None:
        """Show the trajectory that was loaded at the start."""
        if self.trajectories is not None:
            self.trajectories.show()

    def deactivate(self) -> None:
        """Leave the vehicle with a zero command."""
        self.follower.stop()
        self.cmd_vel.publish(self.twist(0.0, 0.0, self.now_ns()))

    def clock_jumped(self) -> None:
        """Forget stamps; brake."""
        self.follower.reset()
        self.answered_ns = self.heard_ns = 0

    def hear(self, stamp: int) -> int:
        """Remember that an input of this stamp is being answered; return the time to answer at."""
        self.answered_ns = max(self.answered_ns, stamp)
        self.heard_ns = max(self.now_ns(), stamp)  # the clock of a simulation may come later than what it stamps
        return self.heard_ns

    def on_tick(self) -> None:
        """Keep a command alive while no pose comes; one that is still based on a pose carries its stamp."""
        now = self.now_ns()
        if now - self.heard_ns > SILENT_PERIODS * 1e9 * self.params.period:
            is_based = now - self.answered_ns <= 1e9 * self.params.safety.max_pose_silence
            self.publish(self.follower.tick(now), self.answered_ns if is_based else now)

    # --- commands
    def publish(self, command: Command, stamp: int) -> None:
        """Send a command with the stamp of what it answers, and say what the follower does."""
        frame = self.params.map_frame
        is_idle = command.status.state in (State.NO_PATH, State.IDLE)
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

    def tell(self, status: Status) -> None:
        """Report to the diagnostics; log every change of state or reason."""
        is_stop = status.state in (State.STOPPING, State.STOPPED)
        text = f"{status.state} {status.verdict}".strip()
        self.report("follower", WARN if is_stop else OK, text, progress=status.progress, armed=status.is_armed)
        change = f"{status.state} {status.verdict.reason}"
        if change != self.told:
            (self.log.warning if is_stop else self.log.info)(text)
        self.told = change


def main() -> int:
    """Run the node."""
    return run(PathFollowerNode)
