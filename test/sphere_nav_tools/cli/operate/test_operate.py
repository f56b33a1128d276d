"""The page's parts: what is heard, who confirms, what is told in words, what is drawn for one browser."""

import re
import sys
from contextlib import nullcontext
from itertools import chain, repeat
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped

from sphere_nav.geometry import SE3
from sphere_nav.ros.conversions import se3_to_pose_with_covariance
from sphere_nav_tools.cli.main import main
from sphere_nav_tools.cli.operate import words
from sphere_nav_tools.cli.operate.chart import COLORS, Chart, ground_point, way_ahead
from sphere_nav_tools.cli.operate.link import Link
from sphere_nav_tools.cli.operate.look import dressing
from sphere_nav_tools.cli.operate.page import possible
from sphere_nav_tools.cli.operate.teaching import SimulatedVehicle
from sphere_nav_tools.cli.operate.words import Heard, banner, ellipse, log_of
from sphere_nav_tools.offline.routes import network_of


def test_without_viser_it_says_what_to_type(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "viser", None)
    assert main(["operate"]) == 2
    assert "operate: expected the package viser, found none: pip install" in capsys.readouterr().err


STOPPED = SimpleNamespace(
    state="STOPPED", reason="OFF_PATH", value=1.25, limit=1.0, remedy="bring it <onto> the path", progress=3.0
)
STOPPED.distance_to_end = 7.0


def test_state_reason_and_remedy_are_told():
    seen = Heard()
    assert banner(seen).count("nothing heard") == 2
    seen.hear("follower", STOPPED)
    text = banner(seen)
    assert "OFF_PATH 1.25, limit 1" in text
    assert "bring it &lt;onto&gt; the path" in text
    assert "3.0 m driven, 7.0 m to the end" in text
    mission = {"state": "DRIVING", "edge": "a-b", "next_place": "gate", "distance_remaining": 41.4}
    seen.hear("mission", SimpleNamespace(**mission, time_remaining=30.0))
    assert "mission: DRIVING on a-b, 41 m, 30 s to gate" in banner(seen)


@pytest.mark.parametrize(("later", "is_told"), [(1.4, True), (1.6, False)])
def test_an_old_state_is_shown_as_unknown_after_a_second_and_a_half(monkeypatch, later, is_told):
    seen = Heard()
    seen.hear("follower", STOPPED)
    now = words.time.monotonic()
    monkeypatch.setattr(words.time, "monotonic", lambda: now + later)
    text = banner(seen)
    assert ("OFF_PATH" in text, "3.0 m driven" in text, "silent for 2 s" in text) == (is_told, is_told, not is_told)


def test_an_uncertain_pose_is_drawn_two_deviations_wide_along_its_axes():
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    along, across = np.abs(ellipse(turn @ np.diag([0.09, 0.01]) @ turn.T) @ turn).max(axis=0)
    assert (along, across) == (pytest.approx(0.6, abs=0.01), pytest.approx(0.2, abs=0.01))


STANDS = SimpleNamespace(state="STANDS", reason="OPERATOR")
OLD, NEW = 1000.0, 0.0  # s since it was heard


@pytest.mark.parametrize(
    ("state", "ages", "told"),
    [
        ("STANDS", chain([OLD] * 3, repeat(NEW)), "STANDS OPERATOR"),
        ("STANDS", repeat(OLD), "NOT CONFIRMED"),
        ("DRIVING", repeat(NEW), "NOT CONFIRMED"),
    ],
    ids=["after", "before", "another"],
)
def test_an_old_status_does_not_confirm_a_new_command(monkeypatch, state, ages, told):
    monkeypatch.setattr("sphere_nav_tools.cli.operate.link.RECENT_S", 60.0 if told == "STANDS OPERATOR" else 0.2)
    link, heard = Link.__new__(Link), []

    def tell(name):
        heard.append(next(ages))
        return STANDS, heard[-1]

    link.seen = SimpleNamespace(told=tell)
    assert link._confirmed(lambda status: status.state == state).startswith(told)
    assert told == "NOT CONFIRMED" or heard == [OLD] * 3 + [NEW]


@pytest.fixture
def ears():
    link = Link.__new__(Link)
    link.seen = Heard()
    return link


def test_a_pose_is_told_with_its_heading_and_covariance(ears):
    covariance = np.diag([0.04, 0.01, 0.1, 1.0, 1.0, 1.0])
    covariance[0, 1] = covariance[1, 0] = 0.005
    message = se3_to_pose_with_covariance(SE3.from_planar(3.0, -4.0, 0.7), covariance, 5, "map")
    assert isinstance(message, PoseWithCovarianceStamped)
    ears._on_pose(message)
    x, y, yaw, told = ears.seen.told("pose")[0]
    assert (x, y, yaw) == pytest.approx((3.0, -4.0, 0.7))
    np.testing.assert_array_equal(told, np.reshape(message.pose.covariance, (6, 6))[:2, :2])
    assert ears.seen.told("way by pose")[0][0].tolist() == [3.0, -4.0]


def test_pictures_come_while_a_page_wants_them_and_again_when_one_is_opened_later(ears, monkeypatch):
    heard, counts, now = [], [], [100.0]
    monkeypatch.setattr("sphere_nav_tools.cli.operate.link.time.monotonic", lambda: now[0])
    ears._wanted_at, ears._pictures, ears._image_topic = -np.inf, [], "image_raw"
    ears.node = SimpleNamespace(
        create_subscription=lambda kind, topic, *_: heard.append(topic) or topic, destroy_subscription=heard.remove
    )
    for is_wanted in (False, True, True, False, False, True):
        now[0] += 1.1
        if is_wanted:
            ears.want_pictures()
        ears._watch()
        counts.append(len(heard))
    assert counts == [0, 2, 2, 2, 0, 2]


@pytest.mark.parametrize(
    ("state", "mission", "is_pressed", "shown"),
    [
        ("IDLE", "IDLE", False, {"start"}),
        ("STOPPED", "IDLE", True, set()),
        ("DRIVING", "IDLE", False, {"pause", "stop"}),
        ("PAUSED", "IDLE", False, {"resume", "stop"}),
        ("PAUSED", "IDLE", True, {"stop"}),
        ("IDLE", "WAITING", False, {"pause", "stop"}),
        ("", "IDLE", False, set()),
    ],
)
def test_buttons_are_shown_where_they_do_something(state, mission, is_pressed, shown):
    seen = Heard()
    if state:
        seen.hear("follower", SimpleNamespace(state=state, reason=""))
    seen.hear("mission", SimpleNamespace(state=mission))
    assert {name for name, is_shown in possible(seen, is_pressed).items() if is_shown} == shown


def test_a_stop_is_offered_where_the_vehicle_has_gone_silent(monkeypatch):
    seen = Heard()
    seen.hear("follower", SimpleNamespace(state="IDLE", reason=""))
    now = words.time.monotonic()
    monkeypatch.setattr(words.time, "monotonic", lambda: now + 5.0)
    assert possible(seen, False) == {"start": False, "resume": False, "pause": False, "stop": True}
    seen.hear("follower", SimpleNamespace(state="STOPPED", reason="OFF_PATH"))
    seen.hear("follower", SimpleNamespace(state="STOPPED", reason="OFF_PATH"))
    assert [line[9:] for line in seen.lines] == ["vehicle: STOPPED OFF_PATH after 5 s of silence", "vehicle: IDLE"]
    assert "vehicle: STOPPED OFF_PATH after 5 s" in log_of(seen)


def test_the_stop_belongs_to_the_document_and_asks_by_a_request_of_its_own():
    text = dressing()
    assert "#sn-stop {position:fixed" in text
    script = text.split('onerror="')[1]
    assert script.count('"') == 1
    assert "document.documentElement.appendChild" in script
    assert "fetch('/' + token + '/emergency_stop'" in script
    assert re.findall(r"(?<![.\w])addEventListener", script) == []  # in an attribute that would be the picture's own


def test_a_map_without_a_taught_path_has_no_places(tmp_path):
    with pytest.raises(ValueError, match="expected a map with a taught path, found none"):
        network_of(tmp_path, None)


def test_another_map_starts_the_drivers_anew_and_by_hand_nobody_else_drives(tmp_path, monkeypatch):
    done = []

    def start(self, node, values):
        self.running[node] = None
        done.append(f"+{node} {values.get('map', '')}".strip())

    def stop(self, node):
        del self.running[node]
        done.append(f"-{node}")

    monkeypatch.setattr(SimulatedVehicle, "start", start)
    monkeypatch.setattr(SimulatedVehicle, "stop", stop)
    vehicle = SimulatedVehicle(tmp_path)
    for name in ("a", "b"):
        vehicle.use(Path(name), Path(f"{name}.tum"))
    assert vehicle.is_driven
    vehicle.rest()
    assert not vehicle.is_driven
    starts, ends = "+dense_localizer {} +path_follower", "-path_follower -dense_localizer"
    wanted = f"+cycab_sim {starts.format('a')} {ends} {starts.format('b')} {ends}"
    assert " ".join(done) == wanted


class Scene:
    def __init__(self):
        self.added = []

    def __getattr__(self, kind):
        def add(name="", *words, **values):
            self.added.append((kind.removeprefix("add_"), name, values))
            return SimpleNamespace(position=None, wxyz=None)

        return add


@pytest.fixture
def chart():
    camera = SimpleNamespace(position=(0.0, 0.0, 0.0), look_at=(0.0, 0.0, 0.0), wxyz=(0.0, 1.0, 0.0, 0.0))
    return Chart(SimpleNamespace(scene=Scene(), camera=camera, atomic=nullcontext))


def test_a_vehicle_is_drawn_before_its_rear_axle_and_as_it_heads(chart):
    covariance = np.diag([0.09, 0.01])
    chart._show_car((5.0, 3.0, np.pi / 2, covariance), 0.2)
    assert chart._car.position == pytest.approx((5.0, 3.0, 0.0))
    assert chart._car.wxyz == pytest.approx((np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))
    (body,) = (values for kind, _, values in chart.client.scene.added if kind == "box")
    assert (body["dimensions"], body["color"]) == ((1.9, 1.2, 0.6), COLORS["ahead"])
    assert body["position"] == pytest.approx((0.6, 0.0, 0.3))
    (outline,) = (values for _, name, values in chart.client.scene.added if name == "/covariance")
    low, high = outline["points"].min(axis=(0, 1)), outline["points"].max(axis=(0, 1))
    np.testing.assert_allclose(low, [-0.6, -0.2, 0.65], atol=0.01)
    np.testing.assert_allclose(high, [0.6, 0.2, 0.65], atol=0.01)
    chart._show_car((6.0, 3.0, 0.0, covariance), 0.9)
    assert [kind for kind, *_ in chart.client.scene.added].count("box") == 1  # it moves
    assert chart._car.position == chart._doubt.position == pytest.approx((6.0, 3.0, 0.0))
    chart._show_car((6.0, 3.0, 0.0, covariance), 1.1)
    boxes = [values["color"] for kind, _, values in chart.client.scene.added if kind == "box"]
    assert boxes == [COLORS["ahead"], COLORS["spheres"]]
    chart._show_car(None, np.inf)
    assert len([kind for kind, *_ in chart.client.scene.added if kind == "box"]) == 2


def test_the_way_ahead_begins_where_the_vehicle_is():
    path = np.column_stack([np.arange(11.0), np.zeros(11)])
    assert way_ahead(path, SimpleNamespace(progress=4.0))[0].tolist() == [4.0, 0.0]
    assert len(way_ahead(path, SimpleNamespace(progress=99.0))) == 2
    assert way_ahead(None, SimpleNamespace(progress=4.0)) is None


def test_the_scale_is_of_a_round_length_and_its_arrow_points_to_y(chart):
    camera = chart.client.camera
    camera.fov, camera.image_height = 1.2, 800
    assert '<i style="width:117px"></i>5 m ' in chart.scale()  # 0.0428 m a pixel, 25 m above
    camera.wxyz, camera.position = (0.0, np.cos(0.25), np.sin(0.25), 0.0), (0.0, 0.0, 50.0)  # turned left by 0.5
    assert '<i style="width:117px"></i>10 m ' in chart.scale()
    assert "rotate(29)" in chart.scale()  # to the right of up


def test_a_click_is_where_its_ray_meets_the_ground():
    assert ground_point((1.0, 2.0, 10.0), (0.3, 0.0, -1.0)).tolist() == pytest.approx([4.0, 2.0])
    assert ground_point((1.0, 2.0, 10.0), (0.3, 0.0, 0.1)) is None


def test_a_view_that_follows_is_never_turned(chart):
    camera = chart.client.camera
    camera.position, camera.look_at = (1.0, 2.0, 20.0), (1.4, 2.3, 0.0)  # a browser tells of two moments
    seen = Heard()
    seen.hear("way by pose", [np.array([1.0, 2.0]), np.array([11.0, 2.0])])
    seen.hear("pose", (11.0, 2.0, 0.0, np.zeros((2, 2))))
    chart.show(seen, False)
    assert camera.position == (1.0, 2.0, 20.0)
    for _ in range(50):
        chart.show(seen, True)
        np.testing.assert_allclose(np.subtract(camera.look_at, camera.position), (0.0, 0.0, -20.0), atol=1e-9)
    assert 0.0 < 11.0 - camera.position[0] < 0.07 * 20.0  # not to the very middle
    np.testing.assert_allclose(camera.position[1:], (2.0, 20.0))
