"""The page over DDS and websocket: token, commands and who confirms them, reload, two pages, dead-man switch."""

import threading
import time

import numpy as np
import pytest

pytest.importorskip("viser", reason="optional: pip install viser")
pytest.importorskip("rclpy")

import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.action import ActionServer
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from sphere_nav_msgs.action import Navigate
from sphere_nav_msgs.msg import FollowerStatus
from sphere_nav_msgs.srv import LoadTrajectory
from std_msgs.msg import Bool, String
from std_srvs.srv import Trigger

from path_follower.routes.building import TaughtDrive, build_network, even_curve
from path_follower.routes.network import Spot
from path_follower.routes.network_file import to_geojson
from sphere_nav.ros import qos
from sphere_nav_tools.cli.operate.link import Link
from sphere_nav_tools.cli.operate.page import OperatorPage
from sphere_nav_tools.cli.operate.teaching import Teaching
from sphere_nav_tools.cli.operate.words import Place
from worlds.browser import Browser, find_browser
from worlds.page_client import WAIT_S, PageClient

TOKEN = "a token of the yard"
SWITCH = "stop the vehicle when this page is lost (dead-man switch)"
STATES = {"start": "DRIVING", "resume": "DRIVING", "pause": "PAUSED", "stop": "STOPPED"}


class FakeFollower:
    """Answers as path_follower does: services, status, the emergency stop."""

    def __init__(self):
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node("path_follower", context=self.context)
        self.state, self.reason, self.emergency, self.loaded = "IDLE", "", [], []
        self.refusal, self.x = "", 0.0
        self.status = self.node.create_publisher(FollowerStatus, "~/status", qos.STATE)
        self.pose = self.node.create_publisher(PoseWithCovarianceStamped, "pose", qos.STATE)
        self.node.create_timer(0.05, self.tell)
        for name, state in STATES.items():
            self.node.create_service(Trigger, f"~/{name}", lambda _, answer, s=state: self.do(s, answer))
        self.node.create_service(LoadTrajectory, "~/load_trajectory", self.load)
        self.node.create_subscription(Bool, "emergency_stop", self.press, qos.LATCHED)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self.executor.spin, daemon=True)
        self.thread.start()

    def tell(self):
        self.status.publish(FollowerStatus(state=self.state, reason=self.reason, remedy="<b>see</b> the log"))
        message = PoseWithCovarianceStamped()
        message.pose.pose.orientation.w, message.pose.pose.position.x = 1.0, self.x
        self.pose.publish(message)

    def do(self, state, answer):
        answer.success, answer.message = not self.refusal, self.refusal
        if answer.success:
            self.state, self.reason = state, self.reason if state == "STOPPED" else ""
        return answer

    def load(self, request, answer):
        self.loaded.append(request.path)
        answer.success = True
        return answer

    def press(self, message):
        self.emergency.append(message.data)
        if message.data:
            self.state, self.reason = "STOPPED", "EMERGENCY_STOP"

    def close(self):
        self.executor.shutdown()
        self.thread.join(WAIT_S)
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture(scope="module")
def yard(tmp_path_factory):
    """A follower, the link to it and a page that asks for a token."""
    folder = tmp_path_factory.mktemp("yard")
    (folder / "loop.csv").write_text("0,0\n9,0\n")
    follower, link = FakeFollower(), Link()
    page = OperatorPage(link, Teaching(folder, [], []), host="127.0.0.1", port=8960, token=TOKEN)
    yield follower, link, page
    page.close()
    link.close()
    page.teaching.close()
    follower.close()


@pytest.fixture
def follower(yard):
    follower, link, _ = yard
    follower.state, follower.reason, follower.refusal = "IDLE", "", ""
    follower.emergency.clear()
    link.seen.lines.clear()
    return follower


@pytest.fixture
def enter(yard):
    """Return how a browser comes in, with the token in its storage."""
    clients = []

    def come(storage=None):
        clients.append(PageClient(yard[2].port, {"sphere_nav_token": TOKEN} if storage is None else storage))
        return clients[-1]

    yield come
    for client in clients:
        client.close()


def wait_until(holds):
    end = time.monotonic() + 3.0 * WAIT_S
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_without_the_token_there_is_nothing_to_press(follower, enter):
    stranger = enter({})
    stranger.set("token", "a token of the yarn")
    stranger.click("enter")
    stranger.wait_for("That is not the token.")
    operator = enter()
    operator.wait_for("EMERGENCY STOP")
    stranger.forge(operator.find("start"), True)
    stranger.forge(operator.find("EMERGENCY STOP"), True)
    time.sleep(0.5)
    assert (follower.state, follower.emergency) == ("IDLE", [])
    for words in ("EMERGENCY", "IDLE", "loop.csv"):
        assert words not in stranger.text()
    stranger.set("token", TOKEN)
    stranger.click("enter")
    stranger.wait_for("EMERGENCY STOP")
    assert stranger.storage == {"sphere_nav_token": TOKEN}
    assert stranger.find("enter") is None


def test_commands_are_confirmed_by_the_node(follower, enter):
    page = enter()
    page.click("load path")
    page.wait_for("loop.csv: loaded")
    assert follower.loaded[-1].endswith("/loop.csv")
    for name, state in (("start", "DRIVING"), ("pause", "PAUSED"), ("resume", "DRIVING"), ("stop", "STOPPED")):
        page.click(name)
        page.wait_for(f"{name}: {state}")
        assert follower.state == state
    assert "&lt;b&gt;see&lt;/b&gt; the log" in page.text()  # what a node says is text
    follower.refusal = "OFF_PATH: 3 m, limit 1"
    page.click("start")
    page.wait_for("start: OFF_PATH: 3 m, limit 1")
    page.click("go there")
    page.wait_for("expected one of route_navigator, found none")


def test_the_map_moves_with_the_vehicle_unless_that_is_switched_off(follower, enter):
    page = enter()
    page.wait_for("map moves with the vehicle")
    wait_until(lambda: page.camera)
    begin = page.camera
    follower.x = 7.0
    try:
        wait_until(lambda: page.camera != begin)
        assert np.subtract(page.camera, begin) == pytest.approx((7.0, 0.0, 0.0))
        page.set("map moves with the vehicle", False)
        time.sleep(0.5)
        follower.x = 9.0
        time.sleep(0.5)
        assert np.subtract(page.camera, begin) == pytest.approx((7.0, 0.0, 0.0))
    finally:
        follower.x = 0.0


def test_a_page_that_is_closed_or_reloaded_changes_nothing_and_two_pages_see_the_same(follower, enter):
    first, second = enter(), enter()
    first.click("start")
    second.wait_for("start: DRIVING")
    first.close()
    time.sleep(0.5)
    assert follower.state == "DRIVING"
    again = enter(first.storage)
    again.wait_for("start: DRIVING")
    again.click("pause")
    second.wait_for("pause: PAUSED")


@pytest.mark.parametrize("is_silent", [False, True], ids=["closed", "frozen"])
def test_with_the_dead_mans_switch_a_lost_page_stops_the_vehicle(follower, enter, is_silent):
    page = enter()
    page.click("start")
    page.wait_for("start: DRIVING")
    page.set(SWITCH, True)
    time.sleep(1.5)
    assert follower.state == "DRIVING"  # a page that lives may go on
    page.is_silent = is_silent
    if not is_silent:
        page.close()
    wait_until(lambda: follower.state == "STOPPED")
    if is_silent:
        page.set(SWITCH, False)
        time.sleep(1.2)  # what it was asked last


def test_the_emergency_stop_is_published_while_it_is_pressed_and_stays_so_when_pressed_twice(yard, follower, enter):
    page = enter()
    page.click("start")
    page.wait_for("start: DRIVING")
    assert follower.node.count_publishers("/emergency_stop") == 0  # no vehicle depends on a page
    page.click("EMERGENCY STOP")
    page.wait_for("emergency stop: STOPPED EMERGENCY_STOP")
    page.click("EMERGENCY STOP is pressed")
    time.sleep(0.3)
    assert set(follower.emergency) == {True}
    page.close()
    again = enter()
    again.click("release the emergency stop")
    again.wait_for("released; start drives again")
    assert follower.emergency[-1] is False
    wait_until(lambda: follower.node.count_publishers("/emergency_stop") == 0)


def test_a_button_on_the_vehicle_is_not_released_by_a_page(yard, follower):
    link = yard[1]
    button = follower.node.create_publisher(Bool, "emergency_stop", qos.LATCHED)
    wait_until(lambda: link.node.count_publishers("/emergency_stop") == 1)
    link.press_emergency()
    wait_until(lambda: follower.emergency)
    assert "/path_follower decides" in link.release_emergency()
    assert set(follower.emergency) == {True}
    follower.node.destroy_publisher(button)


def test_a_follower_that_says_nothing_confirms_nothing(yard, follower, monkeypatch):
    monkeypatch.setattr("sphere_nav_tools.cli.operate.link.CONFIRMED_S", 0.2)
    follower.do = lambda state, answer: Trigger.Response(success=True)  # it says so, and does not drive
    try:
        assert "NOT CONFIRMED" in yard[1].command("start")
    finally:
        del follower.do
    assert "nobody offers dense_localizer/load_map" in yard[1].load_map("campus")


def test_a_place_of_the_network_is_driven_to_by_the_navigator(yard, follower):
    link, asked = yard[1], []
    line = np.column_stack([np.linspace(0.0, 20.0, 201), np.zeros(201)])
    network = build_network([TaughtDrive(even_curve(*line.T, np.zeros(201), np.ones(201)))], "yard")
    network = network.with_place("gate", Spot(next(iter(network.edges)), 12.0))
    assert "nobody offers the action navigate" in link.go(Place("gate", 12.0, 0.0))

    def drive(handle):
        asked.append(handle.request.place)
        handle.publish_feedback(Navigate.Feedback(next_place="gate", distance_remaining=3.0))
        handle.succeed()
        return Navigate.Result(success=True, distance=12.0)

    server = ActionServer(follower.node, Navigate, "navigate", drive)
    shown = follower.node.create_publisher(String, "route_navigator/network", qos.LATCHED)
    shown.publish(String(data=to_geojson(network, is_dense=False)))
    wait_until(lambda: link.navigator and link.seen.told("places")[0])
    place = next(place for place in link.seen.told("places")[0] if place.name == "gate")
    assert place[1:] == pytest.approx((12.0, 0.0), abs=0.1)
    assert link.go(place) == "gate: on the way"
    wait_until(lambda: any("gate: arrived, 12 m" in line for line in link.seen.lines))
    assert asked == ["gate"]
    server.destroy()
    follower.node.destroy_publisher(shown)


def test_in_a_browser_it_is_driven_by_the_mouse_and_the_emergency_stop_stays_in_sight(yard, follower):
    program = find_browser()
    if program is None:
        pytest.skip("no chromium here")
    browser = Browser(program)
    try:
        browser.call("Page.navigate", url=f"http://127.0.0.1:{yard[2].port}")
        wait_until(lambda: "needs the token" in browser.text())
        wait_until(lambda: browser.fill(TOKEN))
        wait_until(lambda: browser.click("enter") or "EMERGENCY" in browser.text())
        wait_until(lambda: browser.text().count("EMERGENCY STOP") == 2)
        assert browser.click("teach", "[role=tab]")  # scrolls the panel down
        wait_until(lambda: browser.click("localise in its map"))
        assert browser.click("start")
        wait_until(lambda: "start: DRIVING" in browser.text())
        assert browser.click("EMERGENCY STOP")
        wait_until(lambda: True in follower.emergency)
        wait_until(lambda: browser.click("release the emergency stop"))
        wait_until(lambda: follower.emergency[-1] is False)
    finally:
        browser.close()
