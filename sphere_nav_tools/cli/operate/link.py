"""What the page hears of the nodes, and what it asks of them: every command is confirmed by who carries it out."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped, Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.task import Future
from sensor_msgs.msg import CompressedImage, Image
from sphere_nav_msgs.action import Navigate
from sphere_nav_msgs.msg import (
    FollowerStatus,
    KeySphereGraph,
    LocalizationStatus,
    NavigatorStatus,
    ReferenceTrajectory,
)
from sphere_nav_msgs.srv import LoadMap, LoadTrajectory
from std_msgs.msg import Bool, String
from std_srvs.srv import Trigger

from sphere_nav.geometry import SE3
from sphere_nav.ros import conversions, qos
from sphere_nav.ros.camera.stream import read_gray
from sphere_nav.ros.conversions.driving import motion_to_command
from sphere_nav.ros.executor import CallbackFailures, GuardedExecutor
from sphere_nav.ros.node import ThrottledLog
from sphere_nav.ros.subscription import full_name
from sphere_nav_tools.cli.constants import (
    ANSWER_S,
    HELD_S,
    LOAD_S,
    LOOK_S,
    RECENT_S,
    SELDOM_S,
    STOP_ANSWER_S,
    STRIDE_S,
    WITHDRAW_S,
)
from sphere_nav_tools.cli.operate.words import AT_REST, IS_IT_RUNNING, Heard, Place, by_buttons, places_of

GOES_ON = ("WAITING", "STARTING", "DRIVING")  # states in which a mission drives, or will by itself
EXPECTED = {  # states, of the one that is asked, that confirm a command
    "path_follower/start": ("DRIVING", "SLOW"),
    "path_follower/resume": ("DRIVING", "SLOW"),
    "path_follower/pause": ("PAUSED",),
    "path_follower/stop": ("STOPPING", *AT_REST),
    "route_navigator/pause": ("PAUSED",),
    "route_navigator/resume": ("STOPPING", *GOES_ON),
}
CancelGoal = Navigate.Impl.CancelGoalService
ACTIONS = ("navigate", "navigate_to_pose")  # what a mission is begun by: ours, and that of Nav2
LOAD_PATH, LOAD_MAP = "path_follower/load_trajectory", "dense_localizer/load_map"
TRAIL_STEP_M, MAX_TRAIL = 0.1, 20_000
GUESS = np.diag([0.25, 0.25, 0.01, 0.01, 0.01, 0.03])  # covariance of a pose that a person drags: 0.5 m, 10 deg
Found = TypeVar("Found")


class Link:
    """A node in a thread of its own. Calls wait, and may come from any other thread."""

    def __init__(self, namespace: str = "", image_topic: str = "image_raw", domain_id: int | None = None) -> None:
        self.seen = Heard()
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain_id)
        self.node = rclpy.create_node("operator_page", namespace=namespace, context=self._context)
        self._image_topic, self._image_times = image_topic, deque[float](maxlen=200)
        self._wanted_at, self._watched_at = -math.inf, 0.0
        self._pictures: list[Any] = []
        self._emergency: Any = None
        self._wheels: Any = None  # publishes cmd_vel while a person drives, and only then
        self._held, self._held_at = (0.0, 0.0), -math.inf
        self._lock = threading.Lock()
        calls = {LOAD_PATH: LoadTrajectory, LOAD_MAP: LoadMap, **dict.fromkeys(EXPECTED, Trigger)}
        self.clients = {name: self.node.create_client(kind, name) for name, kind in calls.items()}
        self._cancels = [self.node.create_client(CancelGoal, f"{name}/_action/cancel_goal") for name in ACTIONS]
        self._navigator = ActionClient(self.node, Navigate, ACTIONS[0])
        self._subscribe()
        failures = CallbackFailures(ThrottledLog(self.node.get_logger()))
        self._executor, self._stopped = GuardedExecutor(failures, context=self._context), Future()
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._executor.spin_until, args=(self._stopped,), daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Leave; an emergency stop that is pressed stays pressed for those who heard it."""
        self._stopped.set_result(0)
        self._thread.join(timeout=2.0)
        self._executor.shutdown(timeout_sec=0.5)
        self.node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    # --- what is heard
    def _subscribe(self) -> None:
        seen, subscribe = self.seen, self.node.create_subscription
        subscribe(FollowerStatus, "path_follower/status", lambda m: seen.hear("follower", m), qos.STATE)
        subscribe(LocalizationStatus, "status", lambda m: seen.hear("localizer", m), qos.STATE)
        subscribe(ReferenceTrajectory, "path_follower/trajectory", self._on_path, qos.LATCHED)
        subscribe(PoseWithCovarianceStamped, "pose", self._on_pose, qos.STATE)
        subscribe(Odometry, "odom", self._on_odometry, qos.SENSOR)
        subscribe(KeySphereGraph, "graph", self._on_graph, qos.LATCHED)
        subscribe(NavigatorStatus, "route_navigator/status", lambda m: seen.hear("mission", m), qos.LATCHED)
        subscribe(String, "route_navigator/network", self._on_network, qos.LATCHED)
        self._initial = self.node.create_publisher(PoseWithCovarianceStamped, "initialpose", qos.STATE)
        for look in (self._stride, self._watch):
            self.node.create_timer(STRIDE_S, look)

    def want_pictures(self) -> None:
        """Hear images and residuals for as long as this is called again: else none is sent here, and none is made."""
        self._wanted_at = time.monotonic()

    def _watch(self) -> None:
        now, hear = time.monotonic(), self.seen.hear
        is_wanted = now - self._wanted_at < RECENT_S
        if is_wanted and not self._pictures:
            kind = CompressedImage if self._image_topic.endswith("/compressed") else Image
            self._watched_at, subscribe = now, self.node.create_subscription
            self._pictures = [
                subscribe(kind, self._image_topic, self._on_image, qos.SENSOR),
                subscribe(Image, "residual", lambda m: hear("residual", m), qos.LARGE),
            ]
        while self._pictures and not is_wanted:
            self.node.destroy_subscription(self._pictures.pop())

    def _on_image(self, message: Any) -> None:
        self.seen.hear("image", message)
        self._image_times.append(time.monotonic())

    def describe_images(self) -> str:
        """Return how many images come in a second, or since when there is none."""
        now, (_, age) = time.monotonic(), self.seen.told("image")
        age = min(age, now - self._watched_at)
        if age > SELDOM_S:
            return f"NO IMAGE on {self._image_topic} for {age:.0f} s: check the camera"
        return f"{sum(now - at < RECENT_S for at in self._image_times) / RECENT_S:.1f} images/s"

    def picture(self, name: str) -> Any:
        """Return the newest `image` or `residual` as grey levels (H, W); None while there is none, or it is broken."""
        message, age = self.seen.told(name)
        try:
            return read_gray(message) if message is not None and age < RECENT_S else None
        except ValueError:
            return None

    def _on_path(self, message: ReferenceTrajectory) -> None:
        points = np.array([(p.position_x, p.position_y) for p in message.points]).reshape(-1, 2)
        self.seen.hear("path", points)

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        self._place("pose", message, np.reshape(message.pose.covariance, (6, 6))[:2, :2])

    def _on_odometry(self, message: Odometry) -> None:
        self._place("wheels", message, np.zeros((2, 2)))

    def _place(self, name: str, message: Any, covariance: Any) -> None:
        """Hear a pose (x, y, yaw, covariance of x and y), and let the way by it grow."""
        T = conversions.pose_to_se3(message.pose.pose)
        point = T.translation[:2]
        self.seen.hear(name, (*point.tolist(), float(T.yaw), covariance))
        way = self.seen.told(f"way by {name}")[0] or []
        if not way or np.hypot(*(point - way[-1])) >= TRAIL_STEP_M:
            self.seen.hear(f"way by {name}", [*way[-MAX_TRAIL:], point])

    def _on_graph(self, message: KeySphereGraph) -> None:
        places = [vertex.pose.position for vertex in message.vertices]
        self.seen.hear("spheres", np.array([(p.x, p.y) for p in places]).reshape(-1, 2))

    def _on_network(self, message: String) -> None:
        self.seen.hear("places", places_of(message.data))

    # --- what is asked; every answer is one line that a person understands
    def command(self, name: str) -> str:
        """Ask to start, stop, pause or resume, and wait until a status shows that it was done."""
        self.seen.refused = ""
        is_mission = name in ("pause", "resume") and self.seen.mission != "IDLE"
        service = f"{'route_navigator' if is_mission else 'path_follower'}/{name}"
        told = self._stop() if name == "stop" else self._ask(service)
        if not told.startswith(EXPECTED[service]):
            self.seen.refused = by_buttons(f"{name}: {told}")
        return f"{name}: {told}"

    def _stop(self) -> str:
        """Stop the follower and end every mission, whoever began it; it is done only where both are confirmed."""
        cancels = self._cancel_missions()
        told = self._ask("path_follower/stop", STOP_ANSWER_S)
        is_answered = all(self._wait(cancel, STOP_ANSWER_S) is not None for cancel in cancels)
        if is_answered and self._until(lambda: self.seen.mission not in GOES_ON):
            return told
        return f"NOT CONFIRMED by the navigator, the mission may go on: use the button on the vehicle ({told})"

    def _cancel_missions(self) -> list[Future]:
        """Ask whoever offers missions to cancel every goal (no id, no stamp); return the answers to come."""
        return [client.call_async(CancelGoal.Request()) for client in self._cancels if client.service_is_ready()]

    def load(self, service: str, path: Path) -> str:
        """Ask the follower or the localiser to take a file."""
        return f"{path}: {self.call(service, LOAD_S, path=str(path)) or 'loaded'}"

    def call(self, name: str, patience: float = ANSWER_S, **fields: Any) -> str:
        """Call a service and return why it was not done; empty where it was."""
        client: Any = self.clients[name]
        if not client.service_is_ready():
            return f"nobody offers {name}: {IS_IT_RUNNING}"
        response = self._wait(client.call_async(client.srv_type.Request(**fields)), patience)
        if response is None:
            return f"{name} did not answer within {patience:g} s: NOT KNOWN whether it was done"
        return "" if response.success else response.message or "refused"

    def press_emergency(self) -> str:
        """Publish the emergency stop until it is released, and call stop: whichever is heard first brakes.

        Nothing is published while it is not pressed: then the vehicle does not depend on this page.
        """
        begin, (status, _) = time.monotonic(), self.seen.told("follower")
        is_standing = status is not None and status.state in AT_REST
        with self._lock:
            if self._emergency is None:
                self._emergency = self.node.create_publisher(Bool, "emergency_stop", qos.LATCHED)
            self._emergency.publish(Bool(data=True))
        stop = self.clients["path_follower/stop"]
        if stop.service_is_ready():
            stop.call_async(Trigger.Request())
        self._cancel_missions()
        confirmed = self._confirmed(lambda it: it.reason == "EMERGENCY_STOP" or (is_standing and it.state in AT_REST))
        return f"emergency stop: {confirmed} after {time.monotonic() - begin:.2f} s"

    def release_emergency(self) -> str:
        """Say that it is released, unless somebody else publishes it too, who may still press it; nothing moves."""
        with self._lock:
            publisher, self._emergency = self._emergency, None
        if publisher is None:
            return "emergency stop: is not pressed here"
        others = self._others_on(publisher.topic_name)
        if not others:
            publisher.publish(Bool(data=False))
        time.sleep(WITHDRAW_S)
        self.node.destroy_publisher(publisher)
        if others:
            return f"emergency stop: withdrawn here; {', '.join(others)} decides: press and release it there"
        return "emergency stop: released; start drives again"

    def _others_on(self, topic: str) -> list[str]:
        """Return who else publishes a topic."""
        names = map(full_name, self.node.get_publishers_info_by_topic(topic))
        return [name for name in names if name != self.node.get_fully_qualified_name()]

    # --- driven by hand, at walking pace
    def hands_off(self) -> str:
        """Return why nobody may drive by hand now; empty where one may."""
        names = self._others_on(self.node.resolve_topic_name("cmd_vel"))
        if self.is_pressed or self.seen.is_moving:
            return "by hand: expected a vehicle that stands, no emergency stop pressed: press stop, or release it"
        return f"by hand: {', '.join(names)} drives by cmd_vel: end it first" if names else ""

    def hold(self, speed: float, turn: float) -> str:
        """Drive for as long as this is called again within `HELD_S`; return why not, empty where it drives."""
        if refusal := self.hands_off():
            return refusal
        with self._lock:
            self._held, self._held_at = (speed, turn), time.monotonic()
            if self._wheels is None:
                heard = self.node.get_subscriptions_info_by_topic(self.node.resolve_topic_name("cmd_vel"))
                is_stamped = any(info.topic_type.endswith("TwistStamped") for info in heard)
                self._wheels = self.node.create_publisher(TwistStamped if is_stamped else Twist, "cmd_vel", qos.COMMAND)
        return ""

    def let_go(self) -> None:
        """Stand, at once."""
        with self._lock:
            self._held, self._held_at = (0.0, 0.0), min(self._held_at, time.monotonic() - HELD_S)
        self._stride()

    def _stride(self) -> None:
        """Send what is held; zero from when it is held no more, for `WITHDRAW_S`, then nothing."""
        with self._lock:
            if self._wheels is None:
                return
            age = time.monotonic() - self._held_at
            speed, turn = self._held if age < HELD_S and self._emergency is None else (0.0, 0.0)
            now, is_stamped = self.node.get_clock().now().nanoseconds, self._wheels.msg_type is TwistStamped
            self._wheels.publish(motion_to_command(speed, turn, now, "base_link", is_stamped=is_stamped))
            if age > HELD_S + WITHDRAW_S:
                self.node.destroy_publisher(self._wheels)
                self._wheels = None

    def guess_pose(self, x: float, y: float, yaw: float) -> str:
        """Tell the localiser where the vehicle is, about."""
        if self.seen.is_moving:
            return "pose: expected a vehicle that stands: press stop first"
        T, stamp = SE3.from_planar(x, y, yaw), self.node.get_clock().now().nanoseconds
        self._initial.publish(conversions.se3_to_pose_with_covariance(T, GUESS, stamp, "map"))
        return f"pose: {x:.1f}, {y:.1f} m, {math.degrees(yaw):.0f} deg is told to the localiser"

    @property
    def has_navigator(self) -> bool:
        """Whether somebody takes missions."""
        return self._navigator.server_is_ready()

    @property
    def is_pressed(self) -> bool:
        """Whether this page holds the emergency stop."""
        return self._emergency is not None

    def go(self, place: Place) -> str:
        """Send the vehicle to a place; the answer is that of the navigator."""
        if not self.has_navigator:
            return "nobody offers the action navigate: start route_navigator, or load a path"
        handle = self._wait(self._navigator.send_goal_async(Navigate.Goal(place=place.name)), ANSWER_S)
        if handle is None or not handle.accepted:
            return f"{place.name}: {'refused' if handle is not None else 'no answer: NOT KNOWN whether it was taken'}"
        handle.get_result_async().add_done_callback(lambda future: self._on_arrival(place, future.result().result))
        return f"{place.name}: on the way"

    def _on_arrival(self, place: Place, result: Navigate.Result) -> None:
        self.seen.say(f"{place.name}: {'arrived' if result.success else result.reason}, {result.distance:.0f} m")

    def _wait(self, future: Any, seconds: float) -> Any:
        """Return the result of a future that the other thread completes; None when the time is over."""
        done = threading.Event()
        future.add_done_callback(lambda _: done.set())
        return future.result() if done.wait(seconds) else None

    def _ask(self, name: str, patience: float = ANSWER_S) -> str:
        """Call a service, and return the state of its node that shows that it was done, or why it was not."""
        who = "mission" if name.startswith("route") else "follower"
        return self.call(name, patience) or self._confirmed(lambda status: status.state in EXPECTED[name], who)

    def _confirmed(self, holds: Callable[[Any], bool], who: str = "follower") -> str:
        """Wait until the follower says so, after now; return its state and reason, or that it is not confirmed."""
        begin = time.monotonic()

        def find() -> str:
            status, age = self.seen.told(who)
            is_so = time.monotonic() - age > begin and holds(status)  # age: infinite before the first
            return f"{status.state} {status.reason}".strip() if is_so else ""

        return self._until(find) or f"NOT CONFIRMED by the {who}: use the button on the vehicle"

    def _until(self, find: Callable[[], Found]) -> Found:
        """Wait until something is found, and return it; nothing when the time is over."""
        begin = time.monotonic()
        while not (found := find()) and time.monotonic() - begin < RECENT_S:
            time.sleep(LOOK_S)
        return found
