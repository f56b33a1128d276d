import pytest

from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.references.reference import References
from dense_localizer.start.startup import Startup, decide
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.params import build
from sphere_nav.photometric import build_pyramid
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.spheres.graph import KeySphere
from worlds.localizer import SMALL_IMAGES, MemoryMap, at, locate
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
