"""Any two cameras side by side become a rectified pair; a pair that is bent drives straight and as far as it did."""

from itertools import pairwise

import cv2
import numpy as np
import pytest

from sphere_mapping.acquisition.stereo.corner_tracks import follow_window
from sphere_mapping.acquisition.stereo.stereo import sphere_from_stereo
from sphere_mapping.acquisition.stereo.stereo_field import StereoField, follow, tangents
from sphere_mapping.acquisition.stereo.stereo_pair import PairGeometry, StereoPair, geometry_of
from sphere_mapping.acquisition.stereo.track_fit import fit_columns
from sphere_mapping.graph.registration import PreparedSphere, align_sphere
from sphere_mapping.params import MapperParams
from sphere_nav.geometry import SE3, Fisheye, Pinhole
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.spheres.sphere import Sphere
from worlds.room import optical, sharp_room

LENSES = {
    "pinhole": (Pinhole(400, 300, 280.0, 281.0, 203.0, 147.0, (-0.2, 0.05, 0.001, -0.002)),) * 2,
    "fisheye": (Fisheye(400, 300, 200.0, 200.0, 199.5, 149.5, (0.02, 0.0, 0.0, 0.0)),) * 2,
    "mixed": (Pinhole(400, 300, 280.0, 280.0, 200.0, 150.0), Fisheye(380, 280, 200.0, 201.0, 190.0, 141.0)),
}
T_LEFT_RIGHT = SE3.exp([0.3, 0.02, -0.01, 0.02, 0.04, -0.03])


@pytest.mark.parametrize("name", LENSES)
def test_points_have_one_row_and_the_disparity_of_their_depth(rng, name):
    left, right = LENSES[name]
    g = geometry_of(left, right, T_LEFT_RIGHT)
    points = rng.uniform((-1, -0.8, 3), (1, 0.8, 9), (200, 3))  # in the left optical frame
    seen = [g.camera.project(points @ g.R_rectified_left.T)[0]]
    seen += [g.camera.project(T_LEFT_RIGHT.inverse().apply(points) @ g.R_rectified_right.T)[0]]
    np.testing.assert_allclose(seen[0][:, 1], seen[1][:, 1], atol=1e-9)
    depth = (points @ g.R_rectified_left.T)[:, 2]
    np.testing.assert_allclose(seen[0][:, 0] - seen[1][:, 0], g.camera.fx * g.baseline_m / depth, atol=1e-9)
    assert g.baseline_m == pytest.approx(np.linalg.norm(T_LEFT_RIGHT.translation))


def test_exchanged_or_stacked_cameras_are_refused():
    left, right = LENSES["pinhole"]
    for T in (T_LEFT_RIGHT.inverse(), SE3.exp([0.0, 0.3, 0, 0, 0, 0]), SE3.exp([0.0, 0.0, 0.3, 0, 0, 0])):
        with pytest.raises(ValueError, match="stereo: expected the right camera beside the left one, found it at"):
            geometry_of(left, right, T)
    with pytest.raises(ValueError, match="expected centres at least"):
        geometry_of(left, right, SE3.identity())
    with pytest.raises(ValueError, match=r"expected metres, .*found 120: millimetres"):
        geometry_of(left, right, SE3.exp([120.0, 0, 0, 0, 0, 0]))


@pytest.mark.slow
@pytest.mark.parametrize("is_raw", [True, False])
def test_images_that_are_rectified_already_are_seen_to_be(is_raw):
    lens, room = LENSES["pinhole"][0], sharp_room((6, 4, 3), shortest=0.1)
    g = geometry_of(lens, lens, SE3.exp([0.3, 0.0, 0.0, 0.0, 0.03, 0.02]))
    if is_raw:
        images = [drawn(room, lens, T) for T in (SE3.identity(), SE3.exp([0.3, 0.0, 0.0, 0.0, 0.03, 0.02]))]
    else:
        T_left = SE3.from_parts(g.R_rectified_left.T, np.zeros(3))
        images = [drawn(room, g.camera, T_left @ SE3.exp([x, 0, 0, 0, 0, 0])) for x in (0.0, g.baseline_m)]
    pair = StereoPair(g)
    left, right = pair.rectify(*images)
    assert pair.geometry.is_rectified is not is_raw
    assert pair.fit.before_px < 0.15
    assert (pair.is_seen is None) is not is_raw
    if is_raw:
        middle = np.array([[200.0, 150.0], [150.0, 120.0], [260.0, 180.0]])
        there, found = follow(left, right, middle)
        assert np.abs(there - middle)[found, 1].max() < 0.3


def drawn(room, lens, T_left_camera):
    fine = Pinhole(600, 466, 300.0, 300.0, 299.5, 232.5)
    image, _ = room.rgbd(fine, optical(SE3.exp([0.3, -0.2, 0.1, 0.05, -0.1, 0.4])) @ T_left_camera)
    at, _ = fine.project(lens.unproject(pixel_grid(lens)))
    return cv2.remap(image, at.astype(np.float32), None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


BENT = StereoField(rows=(0.0, 0.0, 0.0, 0.0, 6.8, 0.0), columns=(0.7, 2.5))
CAMERA = Pinhole(480, 288, 300.0, 300.0, 239.5, 143.5)
BASELINE, NUM_STEPS, STEP_M = 0.4, 7, 0.25
RECTIFIED = PairGeometry(CAMERA, CAMERA, np.eye(3), np.eye(3), CAMERA, BASELINE)
HALL = sharp_room((6, 3, 2), shortest=0.12)


def drawn_bent(pose):
    """Return what the right camera of a pair with the field BENT sees, each ray cast: cv2.remap is 0.012 px off."""
    pixels = pixel_grid(CAMERA)
    at = pixels.copy()
    for _ in range(6):
        at = pixels - np.stack(BENT.shift(*tangents(CAMERA, at)), axis=-1)
    rays = np.stack([*tangents(CAMERA, at), np.ones(at.shape[:-1])], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    return HALL.cast(pose.translation, rays @ pose.rotation.T)[0]


def drive_of(right_of):
    """Return left and right images of a drive straight ahead; `right_of` a pose is what the right camera sees."""
    rng, T_left_right = np.random.default_rng(0), SE3.exp([BASELINE, 0, 0, 0, 0, 0])
    found = []
    for k in range(NUM_STEPS):
        T = optical(SE3.exp([-3.0 + STEP_M * k, 0.3, 0.1, 0.0, 0.0, 0.0]))
        pair = HALL.render(CAMERA, T)[0], right_of(T @ T_left_right)
        noisy = (np.clip(np.rint(image + rng.normal(0, 1.5, image.shape)), 1, 255) for image in pair)
        found.append(tuple(image.astype(np.uint8) for image in noisy))
    return found


def driven(drive, pair):
    """Return metres and degrees a metre of the drive, by the range of the left side of the view only."""
    params, spheres = MapperParams(), []
    for images in [pair.rectify(*images) for images in drive][::2]:
        whole = sphere_from_stereo(*images, CAMERA, BASELINE, params=params.stereo, partial=params.partial)
        one_side = whole.range_m.copy()
        one_side[:, one_side.shape[1] // 2 :] = np.nan
        sphere = Sphere(whole.image, one_side, whole.camera, 0, whole.range_std_m)
        spheres.append(PreparedSphere(sphere))
    T_first_last = SE3.identity()
    for a, b in pairwise(spheres):
        guess = [SE3.exp([2 * STEP_M, 0, 0, 0, 0, 0])]
        found = align_sphere(b, [a.at(SE3.identity())], iter(guess))
        assert found.is_converged
        T_first_last = T_first_last @ found.T_world_camera
    R, length = T_first_last.rotation, STEP_M * (NUM_STEPS - 1)
    return float(T_first_last.translation[0]) / length, float(np.degrees(np.arctan2(R[1, 0], R[0, 0]))) / length


@pytest.mark.slow
def test_a_bent_pair_drives_straight_and_as_far_as_it_did():
    pair, drive = StereoPair(RECTIFIED), drive_of(drawn_bent)
    straight_yaw = driven(drive_of(lambda pose: HALL.render(CAMERA, pose)[0]), StereoPair(RECTIFIED))[1]
    assert abs(straight_yaw) < 0.01  # degrees a metre: what ranges of one side err by
    rows = [pair.rectify(*images) for images in drive] and pair.fit
    straight = [pair.rectify(*images) for images in drive]
    windows = [follow_window(CAMERA, BASELINE, *zip(*straight[k : k + 4], strict=True)) for k in range(NUM_STEPS - 3)]
    columns = fit_columns(CAMERA, BASELINE, [one for one in windows if one is not None])
    assert rows.is_significant
    assert columns.is_significant
    assert np.abs(columns.columns - BENT.columns).max() < 0.03  # px
    rows_only = driven(drive, StereoPair(pair.geometry, StereoField(tuple(rows.rows))))
    assert abs(rows_only[0] - 1) > 0.01  # what the disparity does to it
    known = StereoPair(pair.geometry, StereoField(tuple(rows.rows), tuple(columns.columns)))
    forward, yaw_deg = driven(drive, known)
    assert abs(forward - 1) < 0.005
    assert abs(yaw_deg - straight_yaw) < 0.002
