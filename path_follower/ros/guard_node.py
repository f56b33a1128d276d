"""The node `command_guard`: commands in, fresh ones out, else zero; for bases without a time-out of their own."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import Twist, TwistStamped
from sphere_nav_msgs.msg import GuardStatus
from std_msgs.msg import UInt64

from path_follower.constants import ACKNOWLEDGE, GUARD_PERIOD, LOOK_PERIOD
from path_follower.guard.guard import Guard
from path_follower.guard.params import GuardParams
from path_follower.ros.front import FrontNode
from path_follower.ros.loop_process import run_with_loop
from path_follower.ros.peers import EmergencyStop
from sphere_nav.ros import qos
from sphere_nav.ros.conversions import driving, header
from sphere_nav.ros.endpoints import OK, WARN, Endpoints


class GuardLoop:
    """Depends on steady time alone: no stamp, no /clock."""

    TOPICS = ("cmd_vel", "cmd_vel_in", "path_follower/heartbeat", "emergency_stop", "command_guard/status")

    def __init__(self, endpoints: Endpoints, params: GuardParams) -> None:
        """Open the topics."""
        self.endpoints, self.params = endpoints, params
        self.guard, self.said_at, self.is_spoken_to = Guard(params), 0.0, False
        self.said = "?"  # the reason that was published last
        kind = TwistStamped if params.is_stamped else Twist
        profile = qos.DEEP if endpoints.is_time_simulated else qos.COMMAND  # a simulator waits for each answer
        self.cmd_vel = endpoints.add_publisher("cmd_vel", kind, profile)
        self.status = endpoints.add_publisher("command_guard/status", GuardStatus)
        endpoints.add_subscription("cmd_vel_in", kind, self.on_command, profile)
        needed = params.is_heartbeat_required
        endpoints.add_subscription(
            "path_follower/heartbeat", UInt64, self.on_heartbeat, qos.COMMAND, is_required=needed
        )
        self.emergency = EmergencyStop(endpoints, self.on_emergency)
        endpoints.add_timer(GUARD_PERIOD, self.on_period, is_wall=True)
        endpoints.add_timer(LOOK_PERIOD, self.on_look, is_wall=True)

    def ask(self, name: str, *values: Any) -> None:
        """Carry out a request: stand. A clock that goes backwards changes nothing."""
        if name == "stand":
            self.send(0.0, 0.0)
            self.cmd_vel.wait_for_acknowledgement(ACKNOWLEDGE)

    def on_command(self, message: Twist | TwistStamped) -> None:
        """Hand on a command."""
        twist = message.twist if isinstance(message, TwistStamped) else message
        self.guard.see_command(twist.linear.x, twist.angular.z, self.endpoints.steady_ns() / 1e9)
        self.is_spoken_to = True

    def on_heartbeat(self, message: UInt64) -> None:
        """Hand on a heartbeat."""
        self.guard.see_heartbeat(message.data, self.endpoints.steady_ns() / 1e9)

    def on_emergency(self, is_pressed: bool) -> None:
        """Press or release the emergency stop."""
        self.guard.is_emergency = is_pressed

    def on_look(self) -> None:
        """See who commands, here and past the guard: more than one cannot be followed."""
        self.emergency.look()
        named = {topic: self.endpoints.publishers_of(topic) for topic in ("cmd_vel_in", "cmd_vel")}
        doubts = [f"{topic} is published by {', '.join(names)}" for topic, names in named.items() if len(names) > 1]
        self.guard.doubt = "; ".join(doubts)

    def on_period(self) -> None:
        """Send what is due; tell every change of reason.

        The follower is told right after it has spoken, or when the base stands: the middleware may hold up who sends
        to a process that hangs, and a ramp must not wait for that.
        """
        now = self.endpoints.steady_ns() / 1e9
        speed, yaw_rate = self.guard.pass_on(now)
        self.send(speed, yaw_rate)
        may_tell, self.is_spoken_to = self.is_spoken_to or speed == 0.0, False
        reason, detail = self.guard.reason, self.guard.detail
        text = f"stopped: {reason}: {detail}" if reason else "passing commands on"
        self.endpoints.tell("guard", WARN if reason else OK, text, str(reason))
        if may_tell and (reason != self.said or now - self.said_at >= LOOK_PERIOD):
            stamp = header(self.endpoints.now_ns(), "")
            self.status.publish(GuardStatus(header=stamp, reason=str(reason), detail=detail))
            self.said, self.said_at = reason, now

    def send(self, speed: float, yaw_rate: float) -> None:
        """Publish a command."""
        now, is_stamped = self.endpoints.now_ns(), self.params.is_stamped
        self.cmd_vel.publish(driving.motion_to_command(speed, yaw_rate, now, "base_link", is_stamped=is_stamped))


class CommandGuard(FrontNode):
    """Parameters and lifecycle of the guard."""

    NAME = "command_guard"
    PARAMS = GuardParams
    LOOP_CLASS = GuardLoop
    params: GuardParams


def main() -> int:
    """Run the node."""
    return run_with_loop(CommandGuard)
