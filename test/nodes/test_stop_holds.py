"""A stop that was answered holds: both nodes on a bus, an ideal car, and whatever may happen in any order."""

import math
from contextlib import suppress

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule
from sensor_msgs.msg import LaserScan
from sphere_nav_msgs.srv import LoadTrajectory
from std_msgs.msg import Bool
from tf2_msgs.msg import TFMessage

from path_follower.path import Pose2
from path_follower.ros.navigator_node import RouteNavigator
from path_follower.routes.building import build_network
from path_follower.routes.network import Spot
from path_follower.routes.network_file import write_network
from sphere_nav.localization.status import State
from sphere_nav.ros.conversions.headers import header
from worlds.curves import straight_road
from worlds.trip import SECOND, Trip

EXAMPLES = 12  # of sequences; 1,000 were run once
RAMP = 3.0  # s within which a vehicle of 1.4 m/s stands, gently


class Vehicle(Trip):
    """A trip that is watched: the vehicle moves only after it was asked to."""

    has_obstacle = False

    def __init__(self, folder, rule):
        network = build_network([straight_road(60.0, 1.4)], "campus")
        write_network(folder / "routes.geojson", network.with_place("end", Spot(max(network.edges), 55.0)))
        (folder / "path.csv").write_text("\n".join(f"{x},0" for x in range(0, 60)))
        self.file = str(folder / "path.csv")
        super().__init__(folder / "routes.geojson", Pose2(1.0, 0.0, 0.0), **{"safety.resume": rule})
        self.goals = []
        self.stopped_at = 0.0  # since when nothing may drive off; None: asked for motion since
        mounting = TransformStamped(header=header(0, "base_link"), child_frame_id="laser")
        self.bus.publish("/tf_static", TFMessage(transforms=[mounting]))
        self.live(0.3)

    # --- requests
    def ask(self, node, name):
        answer = node.endpoints.call(name)
        if answer.success and name in ("start", "resume"):
            self.stopped_at = None
        if answer.success and name in ("stop", "pause") and self.stopped_at is None:
            self.stopped_at = self.now
        return answer

    def press(self, is_pressed):
        if is_pressed and self.stopped_at is None:
            self.stopped_at = self.now
        self.bus.publish("/emergency_stop", Bool(data=is_pressed))
        self.hear(self.bus.settle())

    def go(self):
        with suppress(ValueError):
            self.goals.append(self.begin(place="end"))

    def begin(self, **values):
        goal = super().begin(**values)
        self.stopped_at = None
        return goal

    def cancel_all(self):
        for goal in [goal for goal in self.goals if goal.result is None]:
            self.cancel(goal)

    def restart_navigator(self):
        old = self.navigator
        self.bus.nodes.remove(old)
        for wanted in self.bus.listeners.values():
            wanted[:] = [entry for entry in wanted if entry not in old.inputs]
        self.bus._timers = [entry for entry in self.bus._timers if getattr(entry[3], "__self__", None) is not old]
        self.navigator, self.goals = self.bus.add(RouteNavigator, self.values), []

    # --- time
    @property
    def now(self):
        return self.bus.now_ns / SECOND

    def hear(self, records):
        for record in records:
            if record.topic == "/cmd_vel":
                self.watch(abs(record.message.linear.x))
            super().hear([record])

    def watch(self, speed):
        if self.stopped_at is None:
            return
        assert speed <= abs(self.command.linear.x) + 1e-9, "a stop was answered, and the vehicle gains speed"
        assert speed == 0.0 or self.now - self.stopped_at < RAMP, "a stop was answered, and the vehicle drives on"

    def look(self, now):
        ranges = np.full(181, np.inf)
        ranges[85:96] = 2.0 if self.has_obstacle else np.inf
        scan = LaserScan(header=header(now, "laser"), angle_min=-1.57, angle_max=1.57, range_max=20.0)
        scan.angle_increment, scan.ranges = math.pi / 180, ranges.tolist()
        self.bus.publish("/scan", scan)


@pytest.fixture
def make(tmp_path):
    return lambda resume="standing": Vehicle(tmp_path, resume)


def drive_off(vehicle, way):
    if way == "mission":
        vehicle.go()
    else:
        assert vehicle.follower.endpoints.call("load_trajectory", LoadTrajectory.Request(path=vehicle.file)).success
        assert vehicle.ask(vehicle.follower, "start").success
    vehicle.live(4.0)
    assert vehicle.command.linear.x > 0.2


@pytest.mark.parametrize("way", ["mission", "path"])
@pytest.mark.parametrize("stop", ["stop", "pause", "press"])
@pytest.mark.parametrize(
    ("cause", "after", "resume"),
    [("pose", 0.5, "moving"), ("pose", 0.5, "standing"), ("lost", 3.0, "standing"), ("obstacle", 3.0, "moving")],
)
def test_a_vehicle_that_waits_and_is_stopped_stays_when_what_it_waits_for_comes(make, way, stop, cause, after, resume):
    """While it brakes for that, and while it stands."""
    vehicle = make(resume)
    drive_off(vehicle, way)
    vehicle.has_pose, vehicle.has_obstacle = cause != "pose", cause == "obstacle"
    vehicle.localizer = State.LOST if cause == "lost" else State.TRACKING
    vehicle.live(after)
    if stop == "press":
        vehicle.press(True)
        vehicle.live(0.3)
        vehicle.press(False)
    else:
        answer = vehicle.ask(vehicle.follower, stop)
        assert answer.success or (stop == "pause" and "nothing to pause" in answer.message)
    vehicle.live(0.2)
    vehicle.has_pose, vehicle.has_obstacle, vehicle.localizer = True, False, State.TRACKING
    before = vehicle.pose
    vehicle.live(5.0)
    if vehicle.stopped_at is not None:
        assert vehicle.pose.x - before.x < 1.5  # the ramp
        assert vehicle.command.linear.x == 0.0
        restart = vehicle.follower if way == "path" else vehicle.navigator
        name = "resume" if way == "mission" or vehicle.follower.loop.follower.mode.state == "PAUSED" else "start"
        assert vehicle.ask(restart, name).success
        vehicle.live(4.0)
        assert vehicle.command.linear.x > 0.2


@pytest.mark.parametrize("after", [0.0, 0.5, 1.1, 1.3])
@pytest.mark.parametrize("is_replaced", [False, True])
def test_a_stop_right_after_a_goal_holds(make, after, is_replaced):
    vehicle = make()
    if is_replaced:
        drive_off(vehicle, "mission")
    vehicle.go()
    vehicle.live(after)
    assert vehicle.ask(vehicle.follower, "stop").success
    vehicle.live(6.0)
    assert vehicle.command.linear.x == 0.0
    assert vehicle.navigator.mission.state == "HELD"


class AnythingMayHappen(RuleBasedStateMachine):
    """Each rule is an event, and a time after it."""

    folder = None

    @initialize(resume=st.sampled_from(["never", "moving", "standing"]), way=st.sampled_from(["mission", "path", ""]))
    def begin(self, resume, way):
        self.vehicle = Vehicle(self.folder, resume)
        if way:
            drive_off(self.vehicle, way)

    @rule(name=st.sampled_from(["start", "stop", "pause", "resume"]), after=st.sampled_from([0.0, 0.15, 0.5, 2.5]))
    def ask_the_follower(self, name, after):
        self.vehicle.ask(self.vehicle.follower, name)
        self.vehicle.live(after)

    @rule(name=st.sampled_from(["pause", "resume"]), after=st.sampled_from([0.0, 0.5, 2.5]))
    def ask_the_navigator(self, name, after):
        self.vehicle.ask(self.vehicle.navigator, name)
        self.vehicle.live(after)

    @rule(is_pressed=st.booleans(), after=st.sampled_from([0.0, 0.5]))
    def press_or_release(self, is_pressed, after):
        self.vehicle.press(is_pressed)
        self.vehicle.live(after)

    @rule(after=st.sampled_from([0.45, 0.7, 3.0]))
    def lose_the_pose(self, after):
        self.vehicle.has_pose = False
        self.vehicle.live(after)

    @rule(after=st.sampled_from([0.1, 3.0]))
    def lose_the_place(self, after):
        self.vehicle.localizer = State.LOST
        self.vehicle.live(after)

    @rule(after=st.sampled_from([0.1, 3.0]))
    def meet_an_obstacle(self, after):
        self.vehicle.has_obstacle = True
        self.vehicle.live(after)

    @rule(after=st.sampled_from([0.1, 1.0, 5.0]))
    def have_all_back(self, after):
        self.vehicle.has_pose, self.vehicle.has_obstacle, self.vehicle.localizer = True, False, State.TRACKING
        self.vehicle.live(after)

    @rule(after=st.sampled_from([0.0, 1.2, 4.0]))
    def give_a_goal(self, after):
        self.vehicle.go()
        self.vehicle.live(after)

    @rule(after=st.sampled_from([0.0, 2.0]))
    def cancel_the_goal(self, after):
        self.vehicle.cancel_all()
        self.vehicle.live(after)

    @rule(after=st.sampled_from([0.0, 2.0]))
    def load_a_path(self, after):
        self.vehicle.follower.endpoints.call("load_trajectory", LoadTrajectory.Request(path=self.vehicle.file))
        self.vehicle.live(after)

    @rule(after=st.sampled_from([0.5, 2.0]))
    def restart_the_navigator(self, after):
        self.vehicle.restart_navigator()
        self.vehicle.live(after)

    @rule(after=st.sampled_from([0.5]))
    def have_the_clock_jump(self, after):
        self.vehicle.follower.clock_jumped()
        self.vehicle.live(after)


@pytest.mark.slow
def test_whatever_happens_an_answered_stop_holds(tmp_path):
    AnythingMayHappen.folder = tmp_path
    AnythingMayHappen.TestCase.settings = settings(
        max_examples=EXAMPLES, stateful_step_count=6, deadline=None, derandomize=True,
        suppress_health_check=list(HealthCheck), database=None,
    )  # fmt: skip
    case = AnythingMayHappen.TestCase("runTest")
    result = case.defaultTestResult()
    case.run(result)
    assert result.wasSuccessful(), result.errors + result.failures
