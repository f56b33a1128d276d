from contextlib import nullcontext

import numpy as np
import pytest

from dense_localizer.constants import NUM_WHOLE_SEARCHES, SEARCH_PERIOD_S
from dense_localizer.inputs import LocalizerInput
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import References
from dense_localizer.start.search import PoseSearch
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import FINE, Finding, Reason
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
            search._finding, tried = Finding(reason) if reason else FINE, []
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
    references.close()


@pytest.mark.parametrize(("away_m", "is_refused"), [(9.9, False), (10.1, True)])
def test_a_pose_far_from_all_key_spheres_is_refused(room_map, away_m, is_refused):
    search, above = PoseSearch(References(room_map, PARAMS), PARAMS), np.array([0.0, 0.0, away_m])
    far = SE3.from_parts(np.eye(3), room_map.graph[0].T_map_sphere.translation + above)
    with pytest.raises(ValueError, match="expected at most 10 m from a key sphere") if is_refused else nullcontext():
        search.request(far)


@pytest.mark.slow
def test_searches_keep_their_pause_and_forget_a_stale_guess(room, room_map):
    references = References(room_map, PARAMS)
    search = PoseSearch(references, PARAMS)

    def find(pyramid, stamp_ns):
        frame = LocalizerInput(stamp_ns, images=(RigImage(pyramid),))
        return search.find(frame, lambda frame, guess: locate(frame.images, references, PARAMS, guess))

    nothing = build_pyramid(np.random.default_rng(4).integers(0, 255, (120, 160), dtype=np.uint8), PINHOLE)
    search.start_near(at(0.0), LocalizerInput(10**9))
    assert find(nothing, 1_000_000_000).finding.reason is Reason.LOW_OVERLAP
    assert find(pyramid_at(room, at(0.0)), 1_100_000_000).candidate is not None  # near the lost pose: at once
    search.start_near(at(0.0), LocalizerInput(10**9))
    find(nothing, 1_400_000_000)
    pose = at(-2.0, 0.2, 3.0)
    assert find(pyramid_at(room, pose), 1_450_000_000).candidate is None  # elsewhere: after the pause
    assert find(pyramid_at(room, pose), 1_950_000_000).candidate is not None


def test_of_the_poses_near_a_given_one_each_image_asks_parts_of_another(asked):
    search, ask = asked
    search._is_automatic = False
    search.start_near(at(0.0), LocalizerInput(10**9))
    rounds = ask(8, 0.1)
    turns = [[guess.asks_parts for guess in tried].index(True) for tried in rounds]
    assert all(sum(guess.asks_parts for guess in tried) == 1 for tried in rounds)
    assert all(guess.is_near for tried in rounds for guess in tried)
    assert turns == [number % len(rounds[0]) for number in range(8)]
    assert len(rounds[0]) > 1


def test_who_is_lost_for_long_is_searched_for_in_another_light_and_turned_in_turn(asked):
    _, ask = asked
    rounds = ask(NUM_WHOLE_SEARCHES + 4, SEARCH_PERIOD_S)
    found = [(any(one.T_map_camera is T for one in tried)) for tried in rounds for T in (BY_PARTS, TURNED)]
    pairs = list(zip(found[::2], found[1::2], strict=True))
    assert pairs[:NUM_WHOLE_SEARCHES] == [(True, True)] * NUM_WHOLE_SEARCHES
    assert sorted(pairs[-2:]) == sorted(pairs[-4:-2]) == [(False, True), (True, False)]
    assert all(len(tried) > 1 for tried in rounds)  # upright ones each time


def test_of_two_cameras_each_is_asked_both_ways(asked, room, monkeypatch):
    search, _ = asked
    monkeypatch.setattr(search._startup, "propose", lambda *_: [])
    frame = LocalizerInput(10**9, images=(RigImage(pyramid_at(room, at(0.3))),) * 2)
    search._num_whole = 2 * NUM_WHOLE_SEARCHES
    told = [[one.T_map_camera for part in search._propose_anywhere(frame) for one in part] for _ in range(4)]
    assert [one is TURNED for (one,) in told] == [True, True, False, False]


def test_a_new_request_asks_everything_again(asked):
    search, ask = asked
    ask(NUM_WHOLE_SEARCHES + 1, SEARCH_PERIOD_S)
    search.request(None)
    (tried,) = ask(1, SEARCH_PERIOD_S)
    assert {id(BY_PARTS), id(TURNED)} <= {id(one.T_map_camera) for one in tried}


def test_a_lost_pose_moves_with_the_odometry(asked, room, monkeypatch):
    search, _ = asked
    search._is_automatic, tried = False, []
    monkeypatch.setattr(search._startup, "propose_near", lambda images, T: tried.append(T) or [])
    step, lost, odom = SE3.from_planar(0.4, 0.1, 0.2), at(0.5, 0.0, 0.3), SE3.from_planar(7.0, 1.0, 2.0)
    pyramid = pyramid_at(room, at(0.3))
    nowhere = locate([RigImage(pyramid)], search._references, PARAMS, Prediction.guess(at(50.0)))

    def find(number, T_odom):
        frame = LocalizerInput(10**9 + number * 10**8, images=(RigImage(pyramid),), T_odom_camera=T_odom)
        search.find(frame, lambda frame, guess: nowhere)

    search.start_near(lost, LocalizerInput(10**9, T_odom_camera=odom))
    for number, T_odom in enumerate([odom @ step, None, odom @ step @ step]):
        find(number, T_odom)
    expected = [lost @ step, lost @ step, lost @ step @ step]
    assert [one.distance(other) < (1e-9, 1e-9) for one, other in zip(tried, expected, strict=True)] == [True] * 3
    search.request(lost)  # by an operator: it moves from the next image on
    for number, T_odom in enumerate([odom, odom @ step], start=3):
        find(number, T_odom)
    assert tried[3] is lost
    assert tried[4].distance(lost @ step) < (1e-9, 1e-9)
