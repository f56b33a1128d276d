"""What can be set in the path follower. Speeds are those of the rear-axle centre, angles are of the front wheel."""

from __future__ import annotations

import math

from sphere_nav.params import group, param, parameters


@parameters
class FrontParams:
    """How far the car reaches ahead."""

    front: float = param(1.55, "from the base frame to the front end of the body", "m", low=0.0)


@parameters
class VehicleParams(FrontParams):
    """The car and what it must never be asked for."""

    wheelbase: float = param(1.2, "distance between the axles", "m", low=0.05)
    rear_steering: float = param(
        0.0, "tan of the rear wheels' angle, against that of the front wheels, as a share of it", low=0.0, high=1.0
    )
    max_steering_angle: float = param(
        0.45, "largest steering angle of the (virtual) front wheel", "rad", low=0.01, high=1.4
    )
    max_speed: float = param(2.0, "largest speed, forward and reverse", "m/s", low=0.05)
    max_acceleration: float = param(0.8, "largest gain of speed", "m/s^2", low=0.01)
    max_deceleration: float = param(0.8, "largest loss of speed in ordinary driving", "m/s^2", low=0.01)
    max_jerk: float = param(2.0, "largest change of acceleration in ordinary driving", "m/s^3", low=0.1)
    stop_deceleration: float = param(4.0, "loss of speed in a stop for safety", "m/s^2", low=0.01)
    max_steering_rate: float = param(0.7, "largest rate of the steering angle", "rad/s", low=0.01)
    rear: float = param(0.35, "from the base frame to the rear end of the body", "m", low=0.0)
    width: float = param(1.2, "width of the body", "m", low=0.05)

    @property
    def virtual_wheelbase(self) -> float:
        """Wheelbase of the car, steered in front alone, that drives the same curves, m.

        With tan(rear) = -s tan(front) all circles have their centre beside one point of the body, which moves along
        the axis of the vehicle: s / (1 + s) wheelbases ahead of the rear axle. It is the place of the base frame.
        """
        return self.wheelbase / (1.0 + self.rear_steering)

    @property
    def max_curvature(self) -> float:
        """Largest curvature of the path that the steering angle allows, 1/m."""
        return math.tan(self.max_steering_angle) / self.virtual_wheelbase


@parameters
class ActuationParams:
    """How commands become motion: the pose is predicted to the time at which a command acts."""

    dead_time: float = param(0.0, "from a command to the first reaction of the car", "s", low=0.0, high=1.0)
    steering_lag: float = param(0.2, "time constant of the steering, first order", "s", low=0.0, high=2.0)
    speed_lag: float = param(0.2, "time constant of the speed, first order", "s", low=0.0, high=2.0)


@parameters
class PathParams:
    """How a taught or given path becomes a reference trajectory."""

    smoothing_length: float = param(2.0, "bends shorter than this wavelength are taken as noise", "m", low=0.0)


@parameters
class SpeedParams:
    """The speeds U* along the trajectory."""

    cruise: float = param(1.4, "speed where nothing asks for less", "m/s", low=0.05, is_live=True)
    is_as_taught: bool = param(True, "not faster than the taught drive, where it has stamps")
    lateral_acceleration: float = param(1.0, "largest lateral acceleration in bends", "m/s^2", low=0.01)
    slow: float = param(0.5, "largest speed while the localisation is DEGRADED", "m/s", low=0.0, is_live=True)


@parameters
class SteeringParams:
    """The lateral part of the law (M15 eq. 25); `law.py` derives the gains from closed-loop poles."""

    k_y: float = param(
        0.81, "gain of the lateral error: the square of the natural frequency along the way", "1/m^2", low=0.0
    )
    k_psi: float = param(1.8, "gain of the heading error: twice damping times natural frequency", "1/m", low=0.0)


@parameters
class SafetyParams:
    """When to stop, and when a stop may end by itself; otherwise only the call `start` drives."""

    max_pose_silence: float = param(
        0.4, "longest time without a pose: by its arrival, and by its stamp where that is older", "s", low=0.01
    )
    max_blind_time: float = param(0.35, "longest drive on predicted poses that no image confirms", "s", low=0.0)
    max_status_silence: float = param(1.5, "longest time without a status of the localiser", "s", low=0.01)
    is_status_required: bool = param(True, "stop unless the localiser says TRACKING or DEGRADED")
    max_deviation: float = param(
        0.5, "standard deviation of the position above which it drives slowly; above twice that it stops", "m", low=0.01
    )
    is_motion_checked: bool = param(True, "stop where the pose moves otherwise than wheels (odom) and commands")
    resume: str = param(
        "moving",
        "what ends a stop for missing poses, status or scans besides the call start: nothing, their return before "
        "standstill, or also two seconds of TRACKING after it",
        choices=("never", "moving", "standing"),
    )
    max_distance: float = param(1.0, "largest distance from the path, also at a start", "m", low=0.01, is_live=True)
    is_scan_required: bool = param(False, "stop if no scan comes")
    obstacle_margin: float = param(0.15, "added to every side of the body", "m", low=0.0, is_live=True)


@parameters
class HomingParams:
    """Driving by direction (`homing.py`)."""

    speed: float = param(0.6, "speed towards the next waypoint", "m/s", low=0.05, is_live=True)
    look_ahead: float = param(2.5, "distance of the point on the direction that a circle leads to", "m", low=0.3)


@parameters
class FollowerParams:
    """Everything that the algorithm needs."""

    vehicle: VehicleParams = group(VehicleParams)
    actuation: ActuationParams = group(ActuationParams)
    path: PathParams = group(PathParams)
    speed: SpeedParams = group(SpeedParams)
    steering: SteeringParams = group(SteeringParams)
    safety: SafetyParams = group(SafetyParams)
    homing: HomingParams = group(HomingParams)


@parameters
class PathFollowerParams(FollowerParams):
    """Everything that the node needs."""

    map_frame: str = param("map", "frame of the poses and of the path")
    base_frame: str = param(
        "base_link", "frame of the vehicle, at the middle of the axle that does not steer; both steer: path_follower.md"
    )
    source: str = param(
        "pose",
        "what the vehicle drives by: its pose, an odometry in the map, or directions of mcl_depth (homing)",
        choices=("pose", "odometry", "homing"),
    )
    trajectory: str = param("", "file of the trajectory (.csv, .tum, .yaml) to load at the start")
    enable_stamped_cmd_vel: bool = param(False, "cmd_vel is a TwistStamped, with the stamp of the pose it answers")
    is_quiet_when_idle: bool = param(False, "send no commands before the first start, so that others may drive")
