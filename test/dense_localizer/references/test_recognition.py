import pytest

from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import References
from dense_localizer.start.startup import Startup, decide
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.localization.status import Reason
from sphere_nav.params import build
from sphere_nav.photometric import build_pyramid
from sphere_nav.photometric.align.rig import RigImage
from sphere_nav.spheres.graph import KeySphere
from worlds.localizer import SMALL_IMAGES, MemoryMap, at, locate
from worlds.room import sharp_room

pytestmark = pytest.mark.slow

# Written out: imported, a change would go unseen.
NUM_RETRIEVED = 12

LENS = Pinhole(320, 240, 200.0, 200.0, 159.5, 119.5)
PARAMS = build(LocalizerParams, SMALL_IMAGES)
ROOMS = [sharp_room(seed=seed) for seed in range(NUM_RETRIEVED + 4)]
GAP = 40.0  # m between the rooms


@pytest.fixture(scope="module")
def references():
    camera = Spherical(512, 256)
    nodes = [
        KeySphere(k, k, SE3.from_planar(GAP * k, 0, 0), r.sphere(SE3.identity(), camera)) for k, r in enumerate(ROOMS)
    ]
    return References(MemoryMap(nodes), PARAMS)


def pyramid_of(room, pose, seed=3):
    return build_pyramid(room.photograph(LENS, pose, seed), LENS, PARAMS.registration.pyramid)


def find_start(references, pyramid):
    poses = Startup(references, PARAMS).propose([RigImage(pyramid)])
    return decide(
        [locate([RigImage(pyramid)], references, PARAMS, Prediction.guess(pose)) for pose in poses], PARAMS.start
    )


@pytest.mark.parametrize(("number", "yaw"), [(0, 0.4), (15, 3.0)])
def test_a_large_map_is_searched_by_what_it_looks_like(references, number, yaw):
    pose = at(0.2, 0.1, yaw)
    start = find_start(references, pyramid_of(ROOMS[number], pose))
    assert start.candidate is not None
    distance, angle = start.candidate.T_map_camera.distance(SE3.from_planar(GAP * number, 0, 0) @ pose)
    assert (distance, angle) < (0.02, 0.01)


def test_a_room_that_is_not_in_the_map_is_not_found(references):
    start = find_start(references, pyramid_of(sharp_room(seed=99), at(0.2, 0.1, 1.0)))
    assert start.candidate is None
    assert start.finding.reason is Reason.LOW_OVERLAP


def test_two_of_many_rooms_alike_are_ambiguous(references):
    twins = [*references.nodes, KeySphere(99, 99, SE3.from_planar(0, GAP, 0), references.node(3).sphere)]
    start = find_start(References(MemoryMap(twins), PARAMS), pyramid_of(ROOMS[3], at(0.1, 0.0, 0.4)))
    assert start.candidate is None
    assert start.finding.reason is Reason.AMBIGUOUS
