from dataclasses import replace

import numpy as np

from sphere_mapping.acquisition.partial.depth_registration import DepthRegistration
from sphere_mapping.acquisition.partial.partial_sphere import RgbdView, sphere_from_rgbd, sphere_from_view
from sphere_mapping.params import PartialParams
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from worlds.room import optical, sharp_room

PINHOLE = Pinhole(320, 240, 260.0, 258.0, 161.0, 118.0)
ROOM = sharp_room()
AT = SE3.exp([0.3, -0.2, 0.1, 0.05, -0.1, 0.4])  # oblique to all walls


def truth_in(sphere, T_room_sphere):
    rays = sphere.camera.unproject(pixel_grid(sphere.camera)) @ T_room_sphere.rotation.T
    return ROOM.cast(T_room_sphere.translation, rays)


def test_range_and_gray_level_are_those_of_the_room():
    camera = Pinhole(320, 240, 260.0, 258.0, 161.0, 118.0, (-0.2, 0.05, 0.001, -0.001))
    image, depth_m = ROOM.rgbd(camera, optical(AT))
    sphere = sphere_from_rgbd(image, depth_m, camera, stamp_ns=5)
    gray, range_m = truth_in(sphere, AT)
    seen = sphere.is_seen
    assert sphere.stamp_ns == 5
    assert seen.mean() > 0.7  # the window fits the view; a fisheye rounds its corners
    error = np.abs(sphere.range_m / range_m - 1)[seen & ~np.isnan(sphere.range_m)]
    # exact on the walls of a pinhole but for its float32 table; a rounded pixel at the edges between walls
    assert np.median(error) < 2e-4
    assert np.percentile(error, 95) < 0.01
    # rounding twice gives 0.4 grey levels rms, interpolation about as much
    assert np.sqrt(np.mean((sphere.gray - gray)[seen] ** 2)) < 1.0


def test_range_is_never_mixed_across_a_depth_edge():
    depth_m = np.full((240, 320), 2.0, dtype=np.float32)
    depth_m[:, 160:] = 5.0
    sphere = sphere_from_rgbd(np.full((240, 320), 90, np.uint8), depth_m, PINHOLE)
    z = sphere.range_m * sphere.camera.unproject(pixel_grid(sphere.camera))[..., 0]
    z = z[np.isfinite(z)]
    assert np.all((np.abs(z - 2.0) < 1e-3) | (np.abs(z - 5.0) < 1e-3))
    assert 0.4 < np.mean(np.abs(z - 2.0) < 1e-3) < 0.6


def test_unknown_depth_stays_unknown_and_far_stays_far():
    image, depth_m = ROOM.rgbd(PINHOLE, optical(AT))
    depth_m[40:80, 50:90] = np.nan
    depth_m[40:80, 100:140] = 0.0
    depth_m[40:80, 150:190] = -1.0
    depth_m[100:140, 50:90] = np.inf
    depth_m[100:140, 100:140] = -np.inf
    sphere = sphere_from_rgbd(image, depth_m, PINHOLE)
    pixels, _ = PINHOLE.project(T_BODY_OPTICAL.inverse().apply(sphere.camera.unproject(pixel_grid(sphere.camera))))
    column, row = pixels[..., 0], pixels[..., 1]

    def block(v, u):
        return (np.abs(row - v) < 18) & (np.abs(column - u) < 18)

    for u in (70, 120, 170):
        assert np.isnan(sphere.range_m[block(60, u)]).all()
    assert np.isposinf(sphere.range_m[block(120, 70)]).all()
    assert np.isnan(sphere.range_m[block(120, 120)]).all()
    assert sphere.is_seen[block(60, 120)].all()


def test_a_camera_beside_the_center_sees_the_range_from_the_center():
    T_sphere_camera = SE3.from_parts(np.eye(3), [0.06, 0.02, -0.03]) @ T_BODY_OPTICAL
    image, depth_m = ROOM.rgbd(PINHOLE, AT @ T_sphere_camera)
    sphere = sphere_from_rgbd(image, depth_m, PINHOLE, T_sphere_camera)
    gray, range_m = truth_in(sphere, AT)
    error = np.abs(sphere.range_m / range_m - 1)[sphere.measured]
    assert sphere.measured.sum() > 0.95 * sphere.is_seen.sum()
    assert np.percentile(error, 99) < 2e-3  # without the parallax it would be 3 %
    assert np.sqrt(np.mean((sphere.gray - gray)[sphere.measured] ** 2)) < 1.5


def test_depth_from_a_camera_beside_the_color_camera_is_moved_to_it():
    T_body_depth = SE3.from_parts(np.eye(3), [0.0, 0.025, 0.0]) @ T_BODY_OPTICAL
    depth_camera = Pinhole(320, 240, 292.0, 292.0, 160.0, 120.0)
    image, _ = ROOM.rgbd(PINHOLE, optical(AT))
    _, depth_m = ROOM.rgbd(depth_camera, AT @ T_body_depth)
    register = DepthRegistration(depth_camera, PINHOLE, T_BODY_OPTICAL.inverse() @ T_body_depth)
    sphere = sphere_from_rgbd(image, register(depth_m), PINHOLE)
    _, range_m = truth_in(sphere, AT)
    assert sphere.measured.mean() > 0.6  # the depth camera sees less than the colour camera
    assert np.percentile(np.abs(sphere.range_m / range_m - 1)[sphere.measured], 99) < 2e-3


def test_a_finer_camera_is_averaged_not_aliased():
    rng = np.random.default_rng(1)
    noise = rng.integers(1, 255, (240, 320)).astype(np.uint8)
    depth_m = np.full((240, 320), 2.0, dtype=np.float32)
    coarse = sphere_from_rgbd(noise, depth_m, PINHOLE, params=PartialParams(resolution=0.25))
    center = coarse.gray[20:40, 25:55]
    # the mean of 4 x 4 pixels has a quarter of their deviation; sampling one of them would keep it all
    assert center.std() < 0.4 * noise.std()


ROLLING = Pinhole(240, 180, 180.0, 180.0, 119.5, 89.5)
PLACE = SE3.exp([-0.5, 0.2, 0.0, 0.0, 0.0, 0.3])
TWIST = 0.68 * np.array([0.04, 0.01, 0.0, 0.005, 0.01, np.radians(1.2)])  # of the sphere, in body axes
OPTICAL_TWIST = T_BODY_OPTICAL.inverse().adjoint() @ TWIST


def rgbd(twist):
    """What the camera sees whose rows are read while it moves by the twist."""
    gray = ROOM.render_rolling(ROLLING, optical(PLACE), twist)
    range_m = ROOM.range_rolling(ROLLING, optical(PLACE), twist)
    depth_m = range_m * ROLLING.unproject(pixel_grid(ROLLING))[..., 2]
    return RgbdView(np.rint(gray).astype(np.uint8), depth_m.astype(np.float32), ROLLING)


def difference(view, other):
    """Mean difference of the grey levels, median relative one of the ranges."""
    one, two = sphere_from_view(view), sphere_from_view(other)
    both = np.isfinite(one.range_m) & np.isfinite(two.range_m)
    off = np.abs(one.image.astype(float) - two.image)[both].mean()
    return off, np.median(np.abs(one.range_m / two.range_m - 1.0)[both])


def test_a_sphere_is_straightened():
    still, moving = rgbd(0.0 * TWIST), rgbd(OPTICAL_TWIST)
    bent, straight = difference(moving, still), difference(replace(moving, twist=TWIST), still)
    assert straight[0] < 0.2 * bent[0]
    assert straight[1] < 0.25 * bent[1]
