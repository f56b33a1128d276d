"""What can be set in the command guard."""

from __future__ import annotations

from sphere_nav.params import param, parameters


@parameters
class GuardParams:
    """Deadline and limits of the commands that are let through."""

    deadline: float = param(
        0.25, "longest time without a command, or without a heartbeat of who commands", "s", low=0.02, high=5.0
    )
    is_heartbeat_required: bool = param(True, "stop unless the sender of the commands beats (path_follower/heartbeat)")
    is_stamped: bool = param(False, "cmd_vel_in and cmd_vel are TwistStamped, not Twist")
    max_speed: float = param(2.0, "largest speed, forward and reverse", "m/s", low=0.0)
    max_yaw_rate: float = param(1.0, "largest yaw rate", "rad/s", low=0.0)
    max_acceleration: float = param(1.5, "largest gain of speed", "m/s^2", low=0.01)
    max_deceleration: float = param(
        5.0, "loss of speed in a stop; ordinary commands may brake as hard", "m/s^2", low=0.01
    )
