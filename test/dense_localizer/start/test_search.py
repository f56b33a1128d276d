from contextlib import nullcontext

import numpy as np
import pytest

from dense_localizer.constants import NUM_WHOLE_SEARCHES, SEARCH_PERIOD_S
from dense_localizer.inputs import LocalizerInput
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import References
from dense_localizer.start.search import PoseSearch
from dense_localizer.start.startup import SearchResult
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import FINE, Reason, Verdict
from sphere_nav.params import build
from sphere_nav.photometric import build_pyramid
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.spheres.graph import Experience
from worlds.localizer import PINHOLE, SMALL_IMAGES, at, locate

PARAMS = build(LocalizerParams, SMALL_IMAGES)
BY_PARTS, TURNED, SNOW = at(1.0), at(2.0), Experience("snow")


def pyramid_at(room, pose, seed=3):
    return build_pyramid(room.photograph(PINHOLE, pose, seed), PINHOLE, PARAMS.registration.pyramid)


@pytest.fixture
def asked(room, room_map, monkeypatch):
    """Return what lists the guesses that each of several images has tried in vain."""
    references = References(room_map, PARAMS)
    search = PoseSearch(references, PARAMS)
    monkeypatch.setattr(search._startup, "propose_by_parts", lambda *_: [(BY_PARTS, SNOW)])
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
    assert not any(one.by_contrast for one in tried)  # it was found by grey levels
    references.close()


@pytest.mark.parametrize(("reason", "number"), [(Reason.LOW_OVERLAP, 1), (Reason.AMBIGUOUS, 0)])
def test_a_given_pose_that_grey_levels_refuse_is_asked_by_contrast(asked, monkeypatch, reason, number):
    search, ask = asked
    monkeypatch.setattr("dense_localizer.start.search.decide", lambda *_: SearchResult(None, Verdict(reason)))
    search.request(at(0.3))
    (tried,) = ask(1, 0.0)
    assert sum(one.by_contrast is True and one.T_map_camera is tried[0].T_map_camera for one in tried) == number


@pytest.mark.parametrize(("away_m", "is_refused"), [(9.9, False), (10.1, True)])
def test_a_pose_far_from_all_key_spheres_is_refused(room_map, away_m, is_refused):
    search, above = PoseSearch(References(room_map, PARAMS), PARAMS), np.array([0.0, 0.0, away_m])
    far = SE3.from_parts(np.eye(3), room_map.graph[0].T_map_sphere.translation + above)
    with pytest.raises(ValueError, match="expected at most 10 m from a key sphere") if is_refused else nullcontext():
        search.request(far)


def test_a_lost_pose_is_tried_at_once_for_two_seconds_and_the_whole_map_every_half(asked):
    search, ask = asked
    search.start_near(at(0.25), LocalizerInput(10**9))
    rounds = ask(10, 0.25)
    assert [any(one.is_near for one in tried) for tried in rounds] == [True] * 9 + [False]
    assert [any(not one.is_near for one in tried) for tried in rounds] == [True, False] * 5


def test_a_vehicle_lost_for_long_is_searched_for_in_another_light_and_turned(asked):
    _, ask = asked
    rounds = ask(NUM_WHOLE_SEARCHES + 4, SEARCH_PERIOD_S)
    found = [(any(one.T_map_camera is T for one in tried)) for tried in rounds for T in (BY_PARTS, TURNED)]
    pairs = list(zip(found[::2], found[1::2], strict=True))
    assert pairs[:NUM_WHOLE_SEARCHES] == [(True, True)] * NUM_WHOLE_SEARCHES
    assert sorted(pairs[-2:]) == sorted(pairs[-4:-2]) == [(False, True), (True, False)]
    assert all(len(tried) > 1 for tried in rounds)  # upright ones each time
