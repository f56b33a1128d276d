"""The node `command_guard`: commands in, fresh ones out, else zero; for bases without a time-out of their own."""

from __future__ import annotations

from geometry_msgs.msg import Twist, TwistStamped
from std_msgs.msg import Bool, UInt64

from path_follower.guard.guard import Guard
from path_follower.guard.params import GuardParams
from sphere_nav.ros import qos
from sphere_nav.ros.conversions import driving
from sphere_nav.ros.node import OK, WARN, ManagedNode
from sphere_nav.ros.run import run

PERIOD = 0.02  # s between two commands to the base


class CommandGuard(ManagedNode):
    """Depends on steady time alone: no stamp, no /clock."""

    NAME = "command_guard"
    PARAMS = GuardParams
    params: GuardParams

    def configure(self) -> None:
        """Open the topics."""
        self.guard, self.told = Guard(self.params), ""
        kind = TwistStamped if self.params.is_stamped else Twist
        self.cmd_vel = self.add_publisher("cmd_vel", kind, qos.COMMAND)
        self.add_subscription("cmd_vel_in", kind, self.on_command, qos.COMMAND)
        needed = self.params.is_heartbeat_required
        self.add_subscription("path_follower/heartbeat", UInt64, self.on_heartbeat, qos.COMMAND, is_required=needed)
        self.add_subscription("emergency_stop", Bool, self.on_emergency, qos.STATE, is_required=False, silence=0.0)
        self.add_timer(PERIOD, self.on_period, is_wall=True)

    def deactivate(self) -> None:
        """Leave the base with a zero command."""
        self.send(0.0, 0.0)
        self.cmd_vel.wait_for_acknowledgement(0.5)

    def on_command(self, message: Twist | TwistStamped) -> None:
        """Hand on a command."""
        twist = message.twist if isinstance(message, TwistStamped) else message
        self.guard.see_command(twist.linear.x, twist.angular.z, self.steady_ns() / 1e9)

    def on_heartbeat(self, message: UInt64) -> None:
        """Hand on a heartbeat."""
        self.guard.see_heartbeat(message.data, self.steady_ns() / 1e9)

    def on_emergency(self, message: Bool) -> None:
        """Press or release the emergency stop."""
        self.guard.is_emergency = message.data

    def on_period(self) -> None:
        """Send what is due; log every change of reason."""
        self.send(*self.guard.pass_on(self.steady_ns() / 1e9))
        reason = self.guard.reason
        self.report("guard", WARN if reason else OK, f"stopped: {reason}" if reason else "passing commands on")
        if reason != self.told:
            (self.log.warning if reason else self.log.info)(f"stopped: {reason}" if reason else "passing commands on")
        self.told = reason

    def send(self, speed: float, yaw_rate: float) -> None:
        """Publish a command."""
        is_stamped, now = self.params.is_stamped, self.now_ns()
        twist = driving.motion_to_twist_stamped(speed, yaw_rate, now, "base_link") if is_stamped else None
        self.cmd_vel.publish(twist or driving.motion_to_twist(speed, yaw_rate))


def main() -> int:
    """Run the node."""
    return run(CommandGuard)
