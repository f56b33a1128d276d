"""An ideal car, its follower and its navigator on an offline bus, with a localiser that knows where it is."""

import math

import numpy as np
from geometry_msgs.msg import Twist
from sphere_nav_msgs.action import Navigate

from path_follower.ros.navigator_node import RouteNavigator
from path_follower.ros.node import PathFollowerNode
from path_follower.vehicle import Motion, drive
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import State, Status
from sphere_nav.ros.bags.replay import OfflineBus
from sphere_nav.ros.conversions import se3_to_pose_with_covariance, status_to_message

SECOND, STEP = 1_000_000_000, 100_000_000
COVARIANCE = 1e-4 * np.eye(6)


class Goal:
    """A goal as a client of the action sees it."""

    def __init__(self, request):
        self.request, self.feedback, self.result = request, [], None

    def publish(self, feedback):
        self.feedback.append(feedback)

    def finish(self, result, *, success):
        self.result = result


class Trip:
    """What is said is kept by topic; the last command is obeyed."""

    localizer, has_pose = State.TRACKING, True

    def __init__(self, network, pose, **values):
        self.values = {"network": str(network)}
        self.bus = OfflineBus(start_ns=SECOND)
        self.follower = self.bus.add(PathFollowerNode, values)
        self.navigator = self.bus.add(RouteNavigator, self.values)
        self.pose, self.said = pose, {}

    @property
    def command(self):
        return self.said.get("/cmd_vel", Twist())

    def begin(self, **values):
        """Give the navigator a goal."""
        check, begin, _ = self.navigator.endpoints.actions["navigate"]
        goal = Goal(Navigate.Goal(**values))
        check(goal.request)
        begin(goal)
        return goal

    def cancel(self, goal):
        self.navigator.endpoints.actions["navigate"][2](goal)

    def hear(self, records):
        for record in records:
            self.said[record.topic] = record.message

    def look(self, now):
        """Publish what else is seen."""

    def live(self, seconds, until=lambda: False):
        """Let time pass until something is so."""
        for _ in range(round(seconds * SECOND / STEP)):
            if until():
                return
            now = self.bus.now_ns + STEP
            self.hear(self.bus.advance(now))
            self.bus.publish("/status", status_to_message(Status(self.localizer, map_id="campus"), now, "map"))
            if self.has_pose:
                planar = SE3.from_planar(*self.pose)
                self.bus.publish("/pose", se3_to_pose_with_covariance(planar, COVARIANCE, now, "map"))
            self.look(now)
            self.hear(self.bus.settle())
            speed, yaw_rate = self.command.linear.x, self.command.angular.z
            motion = Motion(speed, math.atan(1.2 * yaw_rate / speed) if speed else 0.0)
            self.pose = drive(self.pose, motion, 1.2, STEP / SECOND)
