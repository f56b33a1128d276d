"""What the page shows: states in words, ages, places, the ellipse of a covariance."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from sphere_nav_tools.cli.operate import words
from sphere_nav_tools.cli.operate.words import (
    BAD,
    FAIR,
    GOOD,
    NONE,
    Heard,
    banner,
    ellipse,
    health,
    places_of,
    way_driven,
)

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
def test_what_was_said_holds_for_a_second_and_a_half(monkeypatch, later, is_told):
    seen = Heard()
    seen.hear("follower", STOPPED)
    now = words.time.monotonic()
    monkeypatch.setattr(words.time, "monotonic", lambda: now + later)
    text = banner(seen)
    assert ("OFF_PATH" in text, "3.0 m driven" in text, "silent for 2 s" in text) == (is_told, is_told, not is_told)


def test_a_state_has_its_color():
    for state, color in [("DRIVING", GOOD), ("SLOW", FAIR), ("NO_PATH", NONE), ("STOPPED", BAD), ("<i>", BAD)]:
        seen = Heard()
        seen.hear("localizer", SimpleNamespace(state=state, reason="", value=0.0, limit=0.0, remedy=""))
        assert f"background:{color}" in banner(seen)
        assert "limit" not in banner(seen)
        assert "<i>" not in banner(seen)


def test_diagnostics_show_first_what_is_wrong(monkeypatch):
    seen, now = Heard(), words.time.monotonic()
    assert "nothing heard" in health(seen)
    seen.hear("diagnostics", {"a": (0, "fine", now), "b": (2, "no images", now), "c": (0, "fine", now - 60.0)})
    text = health(seen)
    assert text.index("STALE") < text.index("ERROR") < text.index("OK")
    assert "b: no images" in text


def test_places_are_the_points_with_a_name():
    gate = {"type": "Feature", "properties": {"id": 3, "names": ["gate", "home"]}}
    features = [gate | {"geometry": {"type": "Point", "coordinates": [1, 2]}}]
    features += [{"type": "Feature", "properties": {"id": 7}, "geometry": {"type": "Point", "coordinates": [3, 4]}}]
    features += [{"type": "Feature", "properties": {}, "geometry": {"type": "LineString", "coordinates": []}}]
    found = places_of(json.dumps({"type": "FeatureCollection", "features": features}))
    assert found == [("gate", 1.0, 2.0), ("home", 1.0, 2.0)]
    with pytest.raises(ValueError, match="network: expected JSON"):
        places_of("{")


def test_the_ellipse_has_two_deviations_along_its_axes():
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    points = ellipse(5.0, 3.0, turn @ np.diag([0.09, 0.01]) @ turn.T) - (5.0, 3.0)
    along, across = np.abs(points @ turn).max(axis=0)
    assert (along, across) == (pytest.approx(0.6, abs=0.01), pytest.approx(0.2, abs=0.01))


def test_the_way_driven_is_that_of_the_wheels_until_somebody_localises():
    seen = Heard()
    assert way_driven(seen) is None
    seen.hear("odometry", [(0.0, 0.0), (1.0, 0.0)])
    assert way_driven(seen) == [(0.0, 0.0), (1.0, 0.0)]
    seen.hear("pose", (5.0, 5.0, 0.0, np.eye(2)))
    seen.hear("trail", [(5.0, 5.0)])
    assert way_driven(seen) == [(5.0, 5.0)]  # the other is of another frame
