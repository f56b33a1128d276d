"""The page over DDS and websocket: commands and who confirms them, missions, two pages, dead-man switch, the folder."""

import sys
import threading
import time
import urllib.error
import urllib.request

import pytest

pytest.importorskip("viser", reason="optional: pip install viser")
import rclpy
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseWithCovarianceStamped, Twist
from rclpy.action import ActionClient, ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future as RclpyFuture
from sphere_nav_msgs.action import Navigate
from sphere_nav_msgs.msg import FollowerStatus, LocalizationStatus, NavigatorStatus
from sphere_nav_msgs.srv import LoadTrajectory
from std_msgs.msg import Bool, String
from std_srvs.srv import Trigger

from path_follower.routes.building import build_network
from path_follower.routes.network import Spot
from path_follower.routes.network_file import to_geojson
from sphere_nav.geometry import SE3
from sphere_nav.ros import qos
from sphere_nav.ros.maps.writer import MapDetails, save_map
from sphere_nav_tools.cli.gate import Address
from sphere_nav_tools.cli.operate.link import Link
from sphere_nav_tools.cli.operate.page import NAMES, OperatorPage
from sphere_nav_tools.cli.operate.teaching import Teaching
from sphere_nav_tools.cli.operate.words import Place
from worlds import patience
from worlds.curves import straight_road
from worlds.localizer import make_map
from worlds.page_client import RECORDER, WAIT_S, PageClient
from worlds.room import Room

TOKEN = "a token of the yard"
SWITCH = "stop the vehicle when this page is lost (dead-man switch)"
SERVICES = ("start", "stop", "pause", "resume", "load_trajectory")
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
        self.localizer = self.node.create_publisher(LocalizationStatus, "status", qos.STATE)
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

    def tell_map(self, map_id):
        self.localizer.publish(LocalizationStatus(state="TRACKING", map_id=map_id))

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
    page = OperatorPage(Address("operate", "127.0.0.1", 8960, TOKEN), link, Teaching(folder, [], []))
    wait_until(lambda: all(link.clients[f"path_follower/{name}"].service_is_ready() for name in SERVICES))
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
    clients = []

    def come():
        clients.append(PageClient(yard[2].url))
        return clients[-1]

    yield come
    for client in clients:
        client.close()


def wait_until(holds):
    assert patience.wait_until(holds, 60.0)


def ask_to_stop(yard):
    with urllib.request.urlopen(f"{yard[2].url}/emergency_stop", timeout=WAIT_S) as told:
        assert told.status == 200


def test_commands_are_confirmed_by_the_node(follower, enter):
    page = enter()
    page.click("load path", "loop.csv: loaded")
    assert follower.loaded[-1].endswith("/loop.csv")
    for name, state in (("start", "DRIVING"), ("pause", "PAUSED"), ("resume", "DRIVING"), ("stop", "STOPPED")):
        page.click(name, f"{name}: {state}")
        assert follower.state == state
    assert "&lt;b&gt;see&lt;/b&gt; the log" in page.text()  # what a node says is text
    follower.refusal = "OFF_PATH: 3 m, limit 1"
    page.click("start", "NOT DONE: start: OFF_PATH: 3 m, limit 1")  # at the buttons, until the next one is pressed
    page.click("make the way there", "expected one of route_navigator, found none")


def test_a_page_that_is_closed_or_reloaded_changes_nothing_and_two_pages_see_the_same(follower, enter):
    first, second = enter(), enter()
    first.click("start")
    second.wait_for("start: DRIVING")
    first.close()
    time.sleep(0.5)
    assert follower.state == "DRIVING"
    again = enter()
    again.wait_for("start: DRIVING")
    again.click("pause")
    second.wait_for("pause: PAUSED")


@pytest.mark.parametrize("is_silent", [False, True], ids=["closed", "hung"])
def test_with_the_dead_mans_switch_a_lost_page_presses_the_emergency_stop_within_seven_tenths(
    yard, follower, enter, is_silent
):
    page = enter()
    page.click("start", "start: DRIVING")
    page.set(SWITCH, True)
    page.error = "this browser keeps nothing"  # an answer, too
    time.sleep(1.0)
    assert follower.state == "DRIVING"  # a page that lives may go on
    page.is_silent = is_silent
    if not is_silent:
        page.close()
    assert patience.wait_until(lambda: follower.reason == "EMERGENCY_STOP", 0.75)  # 1.2 s, less what the brakes take
    assert "released" in yard[1].release_emergency()
    follower.state = "DRIVING"  # by another page
    time.sleep(1.0)
    assert follower.state == "DRIVING"  # it is pressed once
    page.is_silent = False


def test_by_hand_the_vehicle_drives_while_a_button_is_held_and_stands_at_once_after(yard, follower, enter):
    link, heard = yard[1], []
    wheels = follower.node.create_subscription(
        Twist, "cmd_vel", lambda twist: heard.append((time.monotonic(), twist.linear.x)), qos.COMMAND
    )
    wait_until(lambda: link.node.count_subscribers("cmd_vel"))
    page = enter()
    page.wait_for("ahead, to the left")
    assert follower.node.count_publishers("/cmd_vel") == 0  # nobody is there who could drive

    def hold():
        page.hold("ahead")
        return any(speed == 0.8 for _, speed in heard)

    wait_until(hold)
    last = time.monotonic()  # the browser is gone
    assert patience.wait_until(lambda: heard[-1][1] == 0.0, 2.0)
    assert heard[-1][0] - last < 0.5
    wait_until(lambda: follower.node.count_publishers("/cmd_vel") == 0)
    heard.clear()
    wait_until(hold)
    page.click("ahead")  # let go
    assert patience.wait_until(lambda: heard[-1][1] == 0.0, 2.0)
    follower.state = "DRIVING"
    wait_until(lambda: "expected a vehicle that stands" in link.hold(0.8, 0.0))
    follower.node.destroy_subscription(wheels)


def test_an_emergency_stop_stays_pressed_when_it_is_pressed_twice_or_its_page_is_closed(yard, follower, enter):
    page = enter()
    page.click("start", "start: DRIVING")
    assert follower.node.count_publishers("/emergency_stop") == 0  # no vehicle depends on a page
    ask_to_stop(yard)
    page.wait_for("emergency stop: STOPPED EMERGENCY_STOP")
    page.wait_for('data-pressed="1"')
    ask_to_stop(yard)
    time.sleep(0.3)
    assert set(follower.emergency) == {True}
    with pytest.raises(urllib.error.HTTPError, match="403"):
        urllib.request.urlopen(f"{yard[2].url.rpartition('/')[0]}/guess_of_it/emergency_stop", timeout=WAIT_S)
    page.close()
    again = enter()
    again.click("release the emergency stop", "released; start drives again")
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


class FakeNavigator:
    """Offers missions, as route_navigator does; they last until they are cancelled or `end`."""

    def __init__(self, follower):
        self.node, self.asked, self.goal = follower.node, [], None
        self.does_cancel, self.state = True, "IDLE"
        options = {"cancel_callback": self.cancel, "callback_group": ReentrantCallbackGroup()}
        self.server = ActionServer(self.node, Navigate, "navigate", self.drive, **options)
        self.status = self.node.create_publisher(NavigatorStatus, "route_navigator/status", qos.LATCHED)
        self.tell("IDLE")

    def tell(self, state):
        self.state = state
        self.status.publish(NavigatorStatus(state=state, edge="4", next_place="gate", distance_remaining=3.0))

    async def drive(self, handle):
        self.asked.append(handle.request.place)
        self.goal = RclpyFuture()
        self.tell("DRIVING")
        success = await self.goal
        handle.succeed() if success else handle.canceled()
        self.tell("IDLE")
        return Navigate.Result(success=success, reason="" if success else "canceled", distance=12.0)

    def cancel(self, _):
        if not self.does_cancel:
            return CancelResponse.REJECT
        self.goal.set_result(False)
        return CancelResponse.ACCEPT

    def close(self):
        self.server.destroy()
        self.node.destroy_publisher(self.status)


@pytest.fixture
def navigator(yard, follower):
    link = yard[1]
    navigator = FakeNavigator(follower)
    wait_until(lambda: link._navigator.server_is_ready() and link._cancels[0].service_is_ready())
    wait_until(lambda: link.seen.mission == "IDLE" and link.seen.told("mission")[0] is not None)
    yield navigator
    navigator.close()
    wait_until(lambda: not link._cancels[0].service_is_ready())
    link.seen.hear("mission", NavigatorStatus(state="IDLE"))


@pytest.fixture
def command_line(follower):
    client = ActionClient(follower.node, Navigate, "navigate")
    yield client
    client.destroy()


def test_a_place_of_the_network_is_driven_to_by_the_navigator(yard, follower):
    link = yard[1]
    network = build_network([straight_road(20.0)], "yard")
    network = network.with_place("gate", Spot(next(iter(network.edges)), 12.0))
    assert "nobody offers the action navigate" in link.go(Place("gate", 12.0, 0.0))
    navigator = FakeNavigator(follower)
    shown = follower.node.create_publisher(String, "route_navigator/network", qos.LATCHED)
    shown.publish(String(data=to_geojson(network, is_dense=False)))
    wait_until(lambda: link._navigator.server_is_ready() and link.seen.told("places")[0])
    place = next(place for place in link.seen.told("places")[0] if place.name == "gate")
    assert place[1:] == pytest.approx((12.0, 0.0), abs=0.1)
    assert link.go(place) == "gate: on the way"
    wait_until(lambda: link.seen.mission == "DRIVING")
    assert "nobody offers route_navigator/pause" in link.command("pause")  # the mission's, not the follower's
    navigator.goal.set_result(True)
    wait_until(lambda: any("gate: arrived, 12 m" in line for line in link.seen.lines))
    assert navigator.asked == ["gate"]
    navigator.close()
    follower.node.destroy_publisher(shown)
    wait_until(lambda: not link._cancels[0].service_is_ready())


def test_stop_ends_a_mission_of_the_command_line_and_is_confirmed_where_follower_and_navigator_both_have_stopped(
    yard, follower, navigator, command_line, monkeypatch
):
    command_line.wait_for_server(WAIT_S)
    sent = command_line.send_goal_async(Navigate.Goal(place="gate"))
    wait_until(lambda: navigator.asked == ["gate"] and sent.done())
    ended = sent.result().get_result_async()
    follower.state = "DRIVING"
    assert yard[1].command("stop") == "stop: STOPPED"
    wait_until(ended.done)
    assert (ended.result().status, ended.result().result.reason) == (GoalStatus.STATUS_CANCELED, "canceled")
    monkeypatch.setattr("sphere_nav_tools.cli.operate.link.RECENT_S", 0.3)
    command_line.send_goal_async(Navigate.Goal(place="gate"))
    wait_until(lambda: yard[1].seen.mission == "DRIVING")
    navigator.does_cancel = False
    told = yard[1].command("stop")
    assert told.startswith("stop: NOT CONFIRMED by the navigator")
    assert told.endswith("(STOPPED)")
    navigator.does_cancel = True
    follower.refusal = "the vehicle is deaf"
    assert yard[1].command("stop") == "stop: the vehicle is deaf"
    wait_until(lambda: navigator.state == "IDLE")  # what can be stopped is stopped


MAPPER = "import shutil, sys; shutil.copytree(sys.argv[1], sys.argv[2]); shutil.copy(sys.argv[3], sys.argv[4])"


@pytest.fixture
def programs(tmp_path, monkeypatch):
    """Stand for the recorder and the mapper, which have tests of their own; return the id of the map that is made."""
    made = make_map(Room(), [SE3.from_planar(x, 0.0, 0.0) for x in (-1.0, 0.0, 1.0)])
    save_map(tmp_path / "map", made.graph, MapDetails(map_id="yard"))
    rows = [f"{10 + k} {-1.0 + 0.1 * k} 0 0 0 0 0 1" for k in range(41)]
    (tmp_path / "way.tum").write_text("\n".join(rows) + "\n")

    def map_by(_, *words):
        made, taught = words[words.index("-o") + 1], words[words.index("--taught") + 1]
        return [sys.executable, "-c", MAPPER, str(tmp_path / "map"), made, str(tmp_path / "way.tum"), taught]

    bag = "sphere_nav_tools.cli.operate.teaching."
    output = len("output:=")
    monkeypatch.setattr(f"{bag}node_command", lambda _, *words: [sys.executable, "-c", RECORDER, words[2][output:]])
    monkeypatch.setattr(f"{bag}python_command", map_by)
    return "yard"


@pytest.mark.slow
def test_from_teaching_to_why_it_stands_by_clicks_alone(yard, follower, enter, programs):
    page, link = enter(), yard[1]
    page.set("name", "round")
    page.click("record", "NO IMAGE on image_raw for")
    page.click("end of the drive", "recording round: done 82 messages")
    page.set("drive", "round")
    page.click("make its map", "mapping round: done")
    assert yard[2].teaching.map_of("round")
    follower.tell_map(programs)
    wait_until(lambda: yard[2].map_in_use() is not None)
    page.set("a click on the map", NAMES)
    page.click_map(2.0, 0.3)
    page.set("name of the place", "gate")
    wait_until(lambda: page.parts[page.find("name it")]["visible"])
    page.click("name it", "place gate: kept in round_map")
    assert [place.name for place in link.seen.told("places")[0]] == ["home", "gate"]
    page.set("place", "gate")
    page.click("make the way there", "way to 2.0, 0.0")
    assert follower.loaded[-1].endswith("course.csv")
    assert follower.state == "IDLE"  # nothing moves before start
    wait_until(lambda: page.parts[page.find("start")]["visible"])
    page.click("start", "start: DRIVING")
    ask_to_stop(yard)
    page.wait_for("emergency stop: STOPPED EMERGENCY_STOP")
    page.wait_for("&rarr; &lt;b&gt;see&lt;/b&gt; the log")  # why, and what to do
    assert not page.parts[page.find("start")]["visible"]
    page.click("release the emergency stop", "released; start drives again")
    page.set("a click on the map", "only looks")
    navigator = FakeNavigator(follower)
    page.click("go there", "gate: on the way")
    assert navigator.asked == ["gate"]
    wait_until(lambda: page.parts[page.find("stop")]["visible"])
    page.click("stop", "gate: canceled, 12 m")
    navigator.close()
