from contextlib import nullcontext

import numpy as np
import pytest

from dense_localizer.constants import SEARCH_PERIOD_S
from dense_localizer.inputs import LocalizerInput
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import References
from dense_localizer.start.search import PoseSearch
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import FINE, Reason, Verdict
from sphere_nav.params import build
from sphere_nav.photometric import build_pyramid
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.spheres.graph import Experience
from worlds.localizer import PINHOLE, SMALL_IMAGES, at, locate

PARAMS = build(LocalizerParams, SMALL_IMAGES)
BY_EDGES, TURNED, SNOW = at(1.0), at(2.0), Experience("snow")


def pyramid_at(room, pose):
    return build_pyramid(room.photograph(PINHOLE, pose, 3), PINHOLE, PARAMS.registration.pyramid)


@pytest.fixture
def asked(room, room_map, monkeypatch):
    """Return what lists the guesses that each of several images has tried in vain."""
    references = References(room_map, PARAMS)
    search = PoseSearch(references, PARAMS)
    monkeypatch.setattr(search._startup, "propose_by_edges", lambda *_: [(BY_EDGES, SNOW)])
    monkeypatch.setattr(search._startup, "propose_turned", lambda *_: [TURNED])

    def ask(count, step_s, reason=Reason.LOW_OVERLAP):
        rounds = []
        for number in range(count):
            search._finding, tried = Verdict(reason) if reason else FINE, []
            frame = LocalizerInput(10**9 + round(number * step_s * 1e9), images=(RigImage(pyramid_at(room, at(0.3))),))

            def refuse(frame, guess, tried=tried):
                tried.append(guess)
                return locate(frame.images, references, PARAMS, Prediction.guess(at(50.0)))

            search.find(frame, refuse)
            rounds.append(tried)
        return rounds

    yield search, ask
    references.close()


def test_a_pose_that_is_given_is_tried_as_it_is(room, room_map):
    references = References(room_map, PARAMS)
    search, tried = PoseSearch(references, PARAMS), []
    given = at(0.3, 0.1, 0.2)
    search.request(given)

    def note(frame, guess):
        tried.append(guess)
        return locate(frame.images, references, PARAMS, guess)

    search.find(LocalizerInput(10**9, images=(RigImage(pyramid_at(room, at(0.3, 0.1, 0.2))),)), note)
    assert tried[0].T_map_camera is given
    assert len(tried) > 1
    assert [bool(one.by_contrast) for one in tried] == [True] + [False] * (len(tried) - 1)
    references.close()


def test_a_given_pose_is_asked_by_contrast_and_by_grey_levels_in_turn(asked):
    search, ask = asked
    search.request(at(0.3))
    rounds = ask(3, 0.1)
    assert [tried[0].by_contrast for tried in rounds if tried[0].is_near] == [True, None]
    assert rounds[0][0].asks_parts


@pytest.mark.parametrize(("away_m", "is_refused"), [(9.9, False), (10.1, True)])
def test_a_pose_far_from_all_key_spheres_is_refused(room_map, away_m, is_refused):
    search, above = PoseSearch(References(room_map, PARAMS), PARAMS), np.array([0.0, 0.0, away_m])
    far = SE3.from_parts(np.eye(3), room_map.graph[0].T_map_sphere.translation + above)
    with pytest.raises(ValueError, match="expected at most 10 m from a key sphere") if is_refused else nullcontext():
        search.request(far)


def test_a_lost_pose_is_tried_in_turn_with_the_whole_map_for_two_seconds(asked):
    search, ask = asked
    search.start_near(at(0.25), LocalizerInput(10**9))
    rounds = ask(14, SEARCH_PERIOD_S)
    near = [all(one.is_near for one in tried) for tried in rounds]
    assert near == [True, False] * 5 + [True] + [False] * 3
    search.start_near(at(0.25), LocalizerInput(10**9))
    assert [len(tried) > 0 for tried in ask(3, 0.25 * SEARCH_PERIOD_S)] == [True] * 3  # at once


def test_a_vehicle_is_searched_for_upright_in_another_light_and_turned_in_turn(asked):
    _, ask = asked
    rounds = ask(12, 0.5 * SEARCH_PERIOD_S)
    assert not any(rounds[1::2])  # not yet due again
    found = [[any(one.T_map_camera is T for one in tried) for T in (BY_EDGES, TURNED)] for tried in rounds[::2]]
    assert found == 2 * [[False, False], [True, False], [False, True]]
    assert rounds[0]


def test_where_two_places_look_alike_no_other_kind_of_search_is_asked(asked):
    _, ask = asked
    rounds = ask(4, SEARCH_PERIOD_S, Reason.AMBIGUOUS)
    assert not any(one.T_map_camera in (BY_EDGES, TURNED) for tried in rounds for one in tried)
    assert all(rounds)


def test_of_several_cameras_each_serves_for_every_way_to_look(room_map, monkeypatch):
    search, served = PoseSearch(References(room_map, PARAMS), PARAMS), []
    for name in ("propose", "propose_by_edges", "propose_turned"):
        monkeypatch.setattr(search._startup, name, lambda seen: served.append(seen) or [])
    for k in range(7):
        search.find(LocalizerInput(10**9 + k * 10**9, images=tuple("ab")), None)
    assert "".join(served) == "aaabbba"
