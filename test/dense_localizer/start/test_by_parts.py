"""The search in a light that no key sphere was taken in."""

from types import SimpleNamespace

import numpy as np
import pytest

from dense_localizer.inputs import LocalizerInput
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import References
from dense_localizer.start import by_parts
from dense_localizer.start.by_parts import PartsSearch
from dense_localizer.start.search import PoseSearch
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.params import build
from sphere_nav.photometric import build_pyramid
from sphere_nav.photometric.align.rig import RigImage
from worlds.localizer import SMALL_IMAGES, at, locate, make_map
from worlds.relit import EdgedRoom, relit

pytestmark = pytest.mark.slow

ROOM = EdgedRoom(half=(6.0, 4.0, 2.0), wave_numbers=(1.0, 10.0, 60))
CAMERA = Pinhole(320, 240, 220.0, 220.0, 159.5, 119.5)
PARAMS = build(LocalizerParams, SMALL_IMAGES)


@pytest.fixture(scope="module")
def references():
    places = [SE3.from_planar(x, 0.0, 0.4 * x) for x in (-3.0, 0.0, 3.0)]
    found = References(make_map(ROOM, places, Spherical(1024, 512)), PARAMS)
    yield found
    found.close()


def seen(pose, seed=3):
    image = relit(ROOM.photograph(CAMERA, pose, seed), seed)
    return RigImage(build_pyramid(image, CAMERA, PARAMS.registration.pyramid))


@pytest.mark.parametrize("pose", [at(0.4, 0.1, 0.3), at(-3.6, 0.2, 2.5), at(3.1, -0.3, -1.0)], ids=["a", "b", "c"])
def test_the_likeliest_guess_is_where_the_camera_is(references, pose):
    found = PartsSearch(references, PARAMS.registration).propose(seen(pose), SE3.identity())
    distance, angle = found[0].T_map_camera.distance(pose)
    assert distance < 0.25
    assert angle < 0.06


def test_a_start_from_nowhere_is_found_in_another_light(references):
    search, pose = PoseSearch(references, PARAMS), at(0.4, 0.1, 0.3)
    frame = LocalizerInput(10**9, images=(seen(pose),))
    result = search.find(frame, lambda frame, guess: locate(frame.images, references, PARAMS, guess))
    assert result.candidate is not None
    assert result.candidate.is_by_parts
    assert result.candidate.T_map_camera.distance(pose) < (0.06, 0.02)


def test_only_likely_guesses_ask_parts_of_the_view(references):
    search, tried = PoseSearch(references, PARAMS), []
    frame = LocalizerInput(10**9, images=(seen(at(0.4, 0.1, 0.3)),))

    def refuse(frame, guess):
        tried.append(guess)
        return locate(frame.images, references, PARAMS, Prediction.guess(at(50.0)))

    search.find(frame, refuse)
    assert {guess.asks_parts for guess in tried} == {True, False}
    assert all(guess.asks_parts == (guess.experience is not None) for guess in tried)


def test_what_a_start_is_found_by_is_gone_on_with(references, monkeypatch):
    """The guess that was tried last may have been of another experience."""
    adopted, good = [], SimpleNamespace(is_good=True)
    monkeypatch.setattr(references, "adopt", adopted.append)
    choices = iter(["first", *["later"] * 99])

    def place(frame, guess):
        choice = next(choices)
        return SimpleNamespace(
            T_map_camera=at(0.0), acceptance=good, ncc=0.9 if choice == "first" else 0.8, choice=choice
        )

    frame = LocalizerInput(10**9, images=(seen(at(0.4, 0.1, 0.3)),))
    assert PoseSearch(references, PARAMS).find(frame, place).candidate.choice == "first"
    assert adopted == ["first"]


def test_noise_has_no_guess(references):
    noise = np.random.default_rng(4).integers(0, 255, (240, 320), dtype=np.uint8)
    image = RigImage(build_pyramid(noise, CAMERA, PARAMS.registration.pyramid))
    guesses = PartsSearch(references, PARAMS.registration).propose(image, SE3.identity())
    assert all(guess.score > 3 for guess in guesses)  # as many agree after any fit
    search = PoseSearch(references, PARAMS)
    found = search.find(
        LocalizerInput(10**9, images=(image,)), lambda frame, guess: locate(frame.images, references, PARAMS, guess)
    )
    assert found.candidate is None


def test_of_a_large_map_other_spheres_are_compared_each_time(references, monkeypatch):
    monkeypatch.setattr(by_parts, "NUM_LAID_OUT", 2)
    search = PartsSearch(references, PARAMS.registration)
    drawn = []
    panorama = references.coarse.panorama
    monkeypatch.setattr(references.coarse, "panorama", lambda number: drawn.append(number) or panorama(number))
    for _ in range(2):
        search.propose(seen(at(0.4, 0.1, 0.3)), SE3.identity())
    assert sorted(drawn) == [0, 1, 2]
