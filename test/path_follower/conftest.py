"""A car to drive: a bicycle with actuator lags, rate limits and dead time, and a localiser with noise and latency."""

import math
from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from path_follower.follower import Follower
from path_follower.modes import FollowerState
from path_follower.params import FollowerParams
from path_follower.path import Pose2
from path_follower.reasons import GENTLE
from path_follower.taught import Given
from path_follower.taught import make_path as path_of
from sphere_nav.geometry import SE3

SECOND = 1_000_000_000
FINE_STEP = 0.005  # s


@dataclass
class World:
    """What the follower's own model may not know."""

    steering_lag: float = 0.2
    speed_lag: float = 0.2
    dead_time: float = 0.0
    latency: float = 0.0  # s from a pose to its arrival
    period: float = 0.05  # s between poses
    position_noise: float = 0.0  # m
    yaw_noise: float = 0.0  # rad
    speed_scale: float = 1.0  # wheel radius error
    steering_bias: float = 0.0  # rad
    wheelbase: float = 1.2
    rear_steering: float = 0.0  # tan of the rear wheels' angle over that of the front wheels, to the other side
    seed: int = 0


@dataclass
class Drive:
    """The record of a drive: true poses, errors against the path at every command."""

    commands: list = field(default_factory=list)
    poses: list = field(default_factory=list)
    lateral: list = field(default_factory=list)
    progress: list = field(default_factory=list)

    @property
    def rmse(self):
        return float(np.sqrt(np.mean(np.square(self.lateral))))

    @property
    def worst(self):
        return float(np.max(np.abs(self.lateral)))

    @property
    def final(self):
        return self.commands[-1].status


class Car:
    """A bicycle, its axles steered or not; a Twist is executed as real cars do: the wheels turn to its curvature.

    Each axle moves as its wheels point: the velocity of the rear one and the yaw rate follow from that, the base point
    (the pose) from them. `speed` is that of the base point.
    """

    def __init__(self, pose, world):
        self.pose, self.world = Pose2(*pose), world
        self.speed = self.angle = 0.0
        self.base = world.wheelbase / (1.0 + world.rear_steering)  # what a Twist says of the front wheels
        self.orders = deque([(-1.0, 0.0, 0.0)])

    def order(self, now, speed, yaw_rate):
        wanted = self.orders[-1][2] if abs(speed) < 1e-6 else math.atan(self.base * yaw_rate / speed)
        self.orders.append((now, speed, wanted))

    def drive(self, now, seconds):
        world = self.world
        for i in range(round(seconds / FINE_STEP)):
            then = now + i * FINE_STEP - world.dead_time
            while len(self.orders) > 1 and self.orders[1][0] <= then:
                self.orders.popleft()
            _, speed, angle = self.orders[0]
            self.speed += (speed * world.speed_scale - self.speed) * share(world.speed_lag)
            self.angle += (angle + world.steering_bias - self.angle) * share(world.steering_lag)
            self.move(math.tan(self.angle), -world.rear_steering * math.tan(self.angle))

    def move(self, front, rear):
        """Drive one step; `front`, `rear`: tan of the wheels' angles. Both axles are as fast along the body."""
        ahead = self.world.wheelbase - self.base  # of the base point, from the rear axle
        yaw_rate = self.speed * (front - rear) / self.world.wheelbase
        middle = self.pose.yaw + yaw_rate * FINE_STEP / 2
        sideways = self.speed * rear + yaw_rate * ahead  # of the base point
        dx, dy = self.speed * FINE_STEP, sideways * FINE_STEP
        x = self.pose.x + dx * math.cos(middle) - dy * math.sin(middle)
        y = self.pose.y + dx * math.sin(middle) + dy * math.cos(middle)
        self.pose = Pose2(x, y, self.pose.yaw + yaw_rate * FINE_STEP)


def share(lag):
    return 1 - math.exp(-FINE_STEP / lag) if lag else 1.0


def run(follower, pose, world=None, seconds=300.0, each=None, is_speed_known=False):
    """Drive until the follower has ended; `each(now, follower, car)` may interfere and answer the localiser's state."""
    world = world or World()
    rng = np.random.default_rng(world.seed)
    car, drive, now, is_started = Car(pose, world), Drive(), 0.0, False
    pending = deque()
    path = follower.path
    while now < seconds:
        stamp = round(now * SECOND) + SECOND
        noise = rng.normal(size=3) * (world.position_noise, world.position_noise, world.yaw_noise)
        pending.append((stamp, Pose2(*(np.array(car.pose) + noise)), car.speed))
        state = (each(now, follower, car) if each else None) or "TRACKING"
        if pending[0][0] <= stamp - round(world.latency * SECOND):
            then, measured, speed = pending.popleft()
            command = answer(follower, measured, then, state, speed if is_speed_known else None, stamp)
        else:
            command = follower.tick(stamp)
        if not is_started and follower.watch.pose is not None:
            refusal = follower.start(stamp)
            assert refusal == "", refusal
            is_started = True
        car.order(now, command.speed, command.yaw_rate)
        drive.commands.append(command)
        drive.poses.append(car.pose)
        if follower.location is not None:
            foot = path.advance(
                car.pose, replace(follower.location, arc_length=max(0.0, follower.location.arc_length - 0.5)), 2.0
            )
            drive.lateral.append(foot.cross_track)
            drive.progress.append(follower.location.arc_length)
        if is_started and follower.mode.state in (FollowerState.FINISHED, FollowerState.STOPPED):
            break
        car.drive(now, world.period)
        now += world.period
    return drive


def answer(follower, pose, stamp, state="TRACKING", speed=None, now=None):
    """Show a pose and what the localiser says to a follower; return its command."""
    now = now or max(stamp, follower.limiter.last_ns or stamp)
    follower.watch.see_status(state, now)
    follower.see_pose(SE3.from_planar(*pose), min(stamp, now), speed)
    return follower.tick(now)


def make_path(points, params, yaw=None, speed=None):
    xy, *columns = (None if values is None else np.asarray(values, dtype=float) for values in (points, yaw, speed))
    return path_of(Given(xy, *columns), params)


def course(*pieces, step=0.05, start=(0.0, 0.0, 0.0)):
    """Poses (N, 3) every `step` m along (length m, curvature 1/m) pieces; a negative length is driven backwards."""
    poses = [np.array(start, dtype=float)]
    for length, curvature in pieces:
        count = max(1, round(abs(length) / step))
        for _ in range(count):
            way = length / count
            x, y, yaw = poses[-1]
            middle = yaw + way * curvature / 2
            poses.append(np.array([x + way * math.cos(middle), y + way * math.sin(middle), yaw + way * curvature]))
    return np.array(poses)


def assert_within_limits(drive, params):
    """No command beyond any limit, none that turns on the spot, none that is not finite."""
    vehicle = params.vehicle
    numbers = np.array([(c.stamp_ns / 1e9, c.speed, c.yaw_rate, c.steering_angle) for c in drive.commands])
    assert np.isfinite(numbers).all()
    time, speed, yaw_rate, angle = numbers.T
    slack = 1e-9
    assert np.abs(speed).max() <= vehicle.max_speed + slack
    assert np.abs(angle).max() <= vehicle.max_steering_angle + slack
    gain = np.diff(np.abs(speed)) / np.diff(time)
    assert gain.max() <= vehicle.max_acceleration + 1e-6
    assert gain.min() >= -vehicle.stop_deceleration - 1e-6
    assert np.abs(np.diff(angle) / np.diff(time)).max() <= vehicle.max_steering_rate + 1e-6
    assert np.all(speed[1:] * speed[:-1] >= 0)  # a change of direction passes through standstill
    np.testing.assert_allclose(yaw_rate, speed * np.tan(angle) / vehicle.virtual_wheelbase, atol=1e-12)
    is_gentle = np.array([c.status.verdict.reason in GENTLE for c in drive.commands])
    middle, is_eased = 0.5 * (time[1:] + time[:-1]), is_gentle[1:] & is_gentle[:-1]
    jerk = np.abs(np.diff(np.diff(speed) / np.diff(time)) / np.diff(middle))[is_eased[1:] & is_eased[:-1]]
    assert not len(jerk) or jerk.max() <= vehicle.max_jerk + 1e-6


@dataclass(frozen=True)
class Kit:
    World = World
    run = staticmethod(run)
    answer = staticmethod(answer)
    course = staticmethod(course)
    make_path = staticmethod(make_path)
    assert_within_limits = staticmethod(assert_within_limits)

    def follow(self, poses, world=None, params=None, start=None, each=None, seconds=300.0, **more):
        """Make the path, drive it from its first pose (or `start`), check every command; return the drive."""
        params = params or FollowerParams()
        poses = np.asarray(poses, dtype=float)
        yaw = poses[:, 2] if poses.shape[1] > 2 else None
        follower = Follower(params, make_path(poses[:, :2], params, yaw))
        first = start if start is not None else (*poses[0, :2], follower.path.yaw[0] if yaw is None else yaw[0])
        drive = run(follower, first, world, seconds, each, **more)
        assert_within_limits(drive, params)
        assert all(b >= a - 1e-9 for a, b in zip(drive.progress, drive.progress[1:], strict=False))
        return drive


@pytest.fixture(scope="session")
def kit():
    return Kit()
