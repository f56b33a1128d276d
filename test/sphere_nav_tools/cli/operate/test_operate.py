"""The page's parts: what is heard, who confirms, what is told in words, what is drawn for one browser."""

import json
import sys
from contextlib import nullcontext
from itertools import chain, repeat
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped

from sphere_nav.geometry import SE3
from sphere_nav.ros.conversions import se3_to_pose_with_covariance
from sphere_nav_tools.cli.main import main
from sphere_nav_tools.cli.operate import words
from sphere_nav_tools.cli.operate.link import Link
from sphere_nav_tools.cli.operate.page import COLORS, Desk
from sphere_nav_tools.cli.operate.words import (
    Heard,
    banner,
    ellipse,
    places_of,
)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--token", "short"], "--token: expected 8 characters or more, found 5"),
        (["--folder", "none"], "expected a folder"),
    ],
)
def test_misuse_is_one_line(tmp_path, monkeypatch, capsys, words, message):
    pytest.importorskip("viser")
    monkeypatch.chdir(tmp_path)
    assert main(["operate", *words]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_without_viser_it_says_what_to_type(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "viser", None)
    assert main(["operate"]) == 2
    assert "operate: expected the package viser, found none: pip install" in capsys.readouterr().err


STOPPED = SimpleNamespace(
    state="STOPPED", reason="OFF_PATH", value=1.25, limit=1.0, remedy="bring it <onto> the path", progress=3.0
)
STOPPED.distance_to_end = 7.0


def test_state_reason_and_remedy_are_told_and_what_is_old_is_unknown(monkeypatch):
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
    now = words.time.monotonic()
    monkeypatch.setattr(words.time, "monotonic", lambda: now + 9.0)
    text = banner(seen)
    assert "UNKNOWN" in text
    assert "silent for 9 s" in text
    assert "OFF_PATH" not in text


@pytest.mark.parametrize(("later", "is_told"), [(1.4, True), (1.6, False)])
def test_an_old_state_is_shown_as_unknown_after_a_second_and_a_half(monkeypatch, later, is_told):
    seen = Heard()
    seen.hear("follower", STOPPED)
    now = words.time.monotonic()
    monkeypatch.setattr(words.time, "monotonic", lambda: now + later)
    text = banner(seen)
    assert ("OFF_PATH" in text, "3.0 m driven" in text, "silent for 2 s" in text) == (is_told, is_told, not is_told)


def test_places_are_the_points_with_a_name():
    gate = {"type": "Feature", "properties": {"id": 3, "names": ["gate", "home"]}}
    features = [gate | {"geometry": {"type": "Point", "coordinates": [1, 2]}}]
    features += [{"type": "Feature", "properties": {"id": 7}, "geometry": {"type": "Point", "coordinates": [3, 4]}}]
    features += [{"type": "Feature", "properties": {}, "geometry": {"type": "LineString", "coordinates": []}}]
    found = places_of(json.dumps({"type": "FeatureCollection", "features": features}))
    assert found == [("gate", 1.0, 2.0), ("home", 1.0, 2.0)]
    with pytest.raises(ValueError, match="network: expected JSON"):
        places_of("{")


def test_an_uncertain_pose_is_drawn_two_deviations_wide_along_its_axes():
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    points = ellipse(5.0, 3.0, turn @ np.diag([0.09, 0.01]) @ turn.T) - (5.0, 3.0)
    along, across = np.abs(points @ turn).max(axis=0)
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
    monkeypatch.setattr("sphere_nav_tools.cli.operate.link.CONFIRMED_S", 60.0 if told == "STANDS OPERATOR" else 0.2)
    link, heard = Link.__new__(Link), []

    def tell(name):
        heard.append(next(ages))
        return STANDS, heard[-1]

    link.seen = SimpleNamespace(told=tell)
    assert link._confirmed(lambda status: status.state == state).startswith(told)
    assert told == "NOT CONFIRMED" or heard == [OLD] * 3 + [NEW]


@pytest.fixture
def ears():
    """A link that hears, without a node."""
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
    assert ears.seen.told("trail")[0][0].tolist() == [3.0, -4.0]


class Scene:
    """Keeps what is added to it, as a browser would."""

    def __init__(self):
        self.added = []

    def __getattr__(self, kind):
        def add(name, *words, **values):
            self.added.append((kind.removeprefix("add_"), name, values))
            return SimpleNamespace(position=None, wxyz=None, on_click=lambda act: self.added.append(("click", act, {})))

        return add


@pytest.fixture
def desk():
    desk = Desk.__new__(Desk)
    camera = SimpleNamespace(position=(-3.0, 0.0, 25.0), look_at=(0.0, 0.0, 0.0))
    desk.client = SimpleNamespace(scene=Scene(), camera=camera, atomic=nullcontext)
    desk._drawn, desk._places, desk._middle = {}, [], np.zeros(3)
    desk._follows, desk._place = SimpleNamespace(value=True), SimpleNamespace(options=(), value="")
    return desk


def test_a_vehicle_is_drawn_before_its_rear_axle_and_as_it_heads(desk):
    covariance = np.diag([0.09, 0.01])
    desk._show_car((5.0, 3.0, np.pi / 2, covariance), 0.2)
    assert desk._car.position == pytest.approx((5.0, 3.6, 0.3))
    assert desk._car.wxyz == pytest.approx((np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))
    (box, _, values), (lines, _, outline) = desk.client.scene.added
    assert (box, values["dimensions"], values["color"]) == ("box", (1.9, 1.2, 0.6), COLORS["car"])
    assert (lines, outline["colors"]) == ("line_segments", COLORS["car"])
    low, high = outline["points"].min(axis=(0, 1)), outline["points"].max(axis=(0, 1))
    np.testing.assert_allclose(low, [4.4, 2.8, 0.65], atol=0.01)
    np.testing.assert_allclose(high, [5.6, 3.2, 0.65], atol=0.01)
    desk._show_car((6.0, 3.0, 0.0, covariance), 0.9)
    assert [kind for kind, *_ in desk.client.scene.added].count("box") == 1  # it moves
    assert desk._car.position == pytest.approx((6.6, 3.0, 0.3))
    desk._show_car((6.0, 3.0, 0.0, covariance), 1.1)
    boxes = [values["color"] for kind, _, values in desk.client.scene.added if kind == "box"]
    assert boxes == [COLORS["car"], COLORS["old"]]
    desk._show_car(None, np.inf)
    assert len([kind for kind, *_ in desk.client.scene.added if kind == "box"]) == 2
