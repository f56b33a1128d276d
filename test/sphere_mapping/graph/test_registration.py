import numpy as np
import pytest

from sphere_mapping.acquisition.partial.partial_sphere import sphere_from_rgbd
from sphere_mapping.graph.registration import PreparedSphere, align_sphere, guess_by_rotation
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.spheres.sphere import Sphere
from worlds.room import optical, sharp_room

CAMERA = Pinhole(240, 180, 180.0, 180.0, 119.5, 89.5)
ROOM = sharp_room()
AT = SE3.exp([-0.5, 0.2, 0.0, 0.0, 0.0, 0.3])
MOTION = SE3.exp([0.06, -0.03, 0.02, 0.01, -0.02, 0.03])


def partial(T_room_sphere):
    return PreparedSphere(sphere_from_rgbd(*ROOM.rgbd(CAMERA, optical(T_room_sphere)), CAMERA))


def whole(T_room_sphere):
    camera = Spherical(512, 256)
    rays = camera.unproject(pixel_grid(camera)) @ T_room_sphere.rotation.T
    gray, range_m = ROOM.cast(T_room_sphere.translation, rays)
    image = np.clip(np.rint(gray), 1, 255).astype(np.uint8)
    return PreparedSphere(Sphere(image, range_m.astype(np.float32), camera))


@pytest.mark.parametrize(("make", "scale"), [(partial, 1.0), (whole, 4.0)], ids=["partial", "whole"])
def test_a_motion_is_recovered_from_identity(make, scale):
    motion = SE3.exp(MOTION.log() * scale)
    found = align_sphere(make(AT @ motion), [make(AT).at(AT)], [AT])
    distance, angle = (AT @ motion).distance(found.T_world_camera)
    assert found.is_converged
    assert distance < 0.003  # ideal range; grey levels rounded
    assert angle < np.radians(0.05)


def test_what_the_camera_did_not_see_is_not_in_the_image_that_is_aligned():
    prepared = partial(AT)
    is_seen = prepared.sphere.is_seen
    assert not is_seen.all()
    np.testing.assert_array_equal(np.isnan(prepared.pyramid.images[0]), ~is_seen)


def test_a_turn_is_guessed_from_the_images_alone():
    turn = SE3.exp([0, 0, 0, 0.02, -0.03, 0.12])
    guess = guess_by_rotation(partial(AT @ turn), partial(AT), AT)
    assert (AT @ turn).distance(guess)[1] < 0.02
    other = whole(AT)
    assert guess_by_rotation(other, partial(AT), AT) is AT  # another camera: nothing to compare
