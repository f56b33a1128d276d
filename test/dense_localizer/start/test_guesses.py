"""Where an image is of by its features and by its edges, in any light."""

from __future__ import annotations

import numpy as np
import pytest

from dense_localizer.inputs import LocalizerInput
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import References
from dense_localizer.start.guesses import GRID, EdgeSearch, _cut
from dense_localizer.start.search import PoseSearch
from dense_localizer.start.startup import Startup, decide
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.params import build
from sphere_nav.photometric import build_pyramid
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.spheres.graph import KeySphere
from worlds.localizer import SMALL_IMAGES, MemoryMap, at, locate, make_map
from worlds.relit import EdgedRoom, relit
from worlds.room import sharp_room

pytestmark = pytest.mark.slow

NUM_RETRIEVED = 12

LENS = Pinhole(320, 240, 200.0, 200.0, 159.5, 119.5)
PARAMS = build(LocalizerParams, SMALL_IMAGES)
ROOMS = [sharp_room(seed=seed) for seed in range(NUM_RETRIEVED + 4)]
GAP = 40.0  # m between the rooms


def test_a_large_map_is_searched_by_what_it_looks_like():
    camera = Spherical(512, 256)
    spheres = [room.sphere(SE3.identity(), camera) for room in ROOMS]
    nodes = [KeySphere(k, k, SE3.from_planar(GAP * k, 0, 0), sphere) for k, sphere in enumerate(spheres)]
    references = References(MemoryMap(nodes), PARAMS)
    number, pose = 15, at(0.2, 0.1, 3.0)
    images = [RigImage(build_pyramid(ROOMS[number].photograph(LENS, pose, 3), LENS, PARAMS.registration.pyramid))]
    poses = Startup(references, PARAMS).propose(images[0])
    start = decide([locate(images, references, PARAMS, Prediction.guess(pose)) for pose in poses], PARAMS.start)
    assert start.candidate is not None
    distance, angle = start.candidate.T_map_camera.distance(SE3.from_planar(GAP * number, 0, 0) @ pose)
    assert distance < 0.02
    assert angle < 0.01


ROOM = EdgedRoom(half=(6.0, 4.0, 2.0), wave_numbers=(1.0, 10.0, 60))
CAMERA = Pinhole(320, 240, 220.0, 220.0, 159.5, 119.5)


@pytest.fixture(scope="module")
def references():
    places = [SE3.from_planar(x, 0.0, 0.4 * x) for x in (-3.0, 0.0, 3.0)]
    found = References(make_map(ROOM, places, Spherical(1024, 512)), PARAMS)
    yield found
    found.close()


def seen(pose):
    image = relit(ROOM.photograph(CAMERA, pose, 3), 3)
    return RigImage(build_pyramid(image, CAMERA, PARAMS.registration.pyramid))


def test_a_start_from_nowhere_is_found_in_another_light(references):
    search, pose = PoseSearch(references, PARAMS), at(-0.94, 0.15, 0.23)
    for k in range(2):  # by grey levels, then by edges
        frame = LocalizerInput(10**9 + k * 200_000_000, images=(seen(pose),))
        result = search.find(frame, lambda frame, guess: locate(frame.images, references, PARAMS, guess))
    assert result.candidate is not None
    assert result.candidate.is_by_parts
    assert np.all(np.less(result.candidate.T_map_camera.distance(pose), (0.03, 0.01)))


def test_edges_say_at_which_heading_to_try_the_sphere_and_before_and_behind_it_and_the_next_likely_one(references):
    pose = at(0.4, 0.1, 0.3)
    tried = EdgeSearch(references).propose(seen(pose), SE3.identity())
    middle, behind, before, other = (one.T_map_camera for one in tried)
    assert other.distance(references.node(tried[3].node.id).T_map_sphere)[0] == pytest.approx(0.0, abs=1e-9)
    assert middle.distance(references.node(tried[0].node.id).T_map_sphere)[0] == pytest.approx(0.0, abs=1e-9)
    assert middle.distance(pose)[1] < 0.06
    reach = 0.2 * references.coarse[tried[0].node.id].typical_range_m
    for sign, place in ((-1.0, behind), (1.0, before)):
        np.testing.assert_allclose((middle.inverse() @ place).translation, [0.0, 0.0, sign * reach], atol=1e-9)


def test_what_is_cut_of_an_image_is_its_edges_or_those_of_its_contrast(monkeypatch):
    image, cut = seen(at(0.4, 0.1, 0.3)).pyramid, []
    monkeypatch.setattr("dense_localizer.start.guesses.cut_view", lambda picture, camera, _: cut.append(camera))
    for by_contrast in (False, True):
        _cut(image, SE3.identity(), by_contrast=by_contrast)
    assert cut[0] == CAMERA
    assert cut[1].pixels_per_radian <= np.sqrt(2.0) * GRID.pixels_per_radian < cut[0].pixels_per_radian
