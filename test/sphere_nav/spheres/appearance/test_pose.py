import numpy as np
import pytest

from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.spheres.appearance.features import features_of_image, features_of_sphere
from sphere_nav.spheres.appearance.pose import find_pose, match
from worlds.room import optical, sharp_room

CAMERA = Spherical(512, 256)
ROOM = sharp_room()
HERE = SE3.exp([0.5, -0.4, 0.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("turn", [0.0, 1.6, np.pi, -2.2])
def test_a_sphere_is_placed_at_any_heading_and_beside(turn):
    motion = SE3.exp([0.4, -0.3, 0.1, 0.0, 0.02, 0.0]) @ SE3.exp([0, 0, 0, 0, 0, turn])
    known = features_of_sphere(ROOM.sphere(HERE, CAMERA, 1))
    found = find_pose(features_of_sphere(ROOM.sphere(HERE @ motion, CAMERA, 2)), known)
    assert found is not None
    assert found.num_inliers > 30
    distance, angle = found.T_sphere_camera.distance(motion)
    assert distance < 0.05  # rays are good to a third of a pixel of 12 mrad, walls 3 m away
    assert angle < np.radians(1.0)


def test_a_camera_is_placed():
    lens = Pinhole(400, 300, 250.0, 250.0, 199.5, 149.5)
    known = features_of_sphere(ROOM.sphere(HERE, CAMERA, 1))
    T_sphere_camera = optical(SE3.exp([0.2, 0.1, 0.0, 0.0, 0.0, 0.7]))
    image = ROOM.photograph(lens, HERE @ T_sphere_camera)
    found = find_pose(features_of_image(image, lens), known)
    assert found is not None
    assert found.T_sphere_camera.distance(T_sphere_camera)[0] < 0.1
    assert found.T_sphere_camera.distance(T_sphere_camera)[1] < np.radians(2.0)


@pytest.mark.parametrize("seed", range(4))
def test_few_features_of_another_room_agree_on_anything(seed):
    known = features_of_sphere(ROOM.sphere(HERE, CAMERA))
    found = find_pose(features_of_sphere(sharp_room(seed=100 + seed).sphere(HERE, CAMERA)), known)
    assert found is None or found.num_inliers < 10


def test_nothing_matches_nothing():
    blank = features_of_image(np.full((256, 512), 90, np.uint8), CAMERA)
    known = features_of_sphere(ROOM.sphere(HERE, CAMERA))
    assert len(match(blank, known)) == 0
    assert find_pose(blank, known) is None
