"""Errors of matches with and without range; corrections as they are meant."""

import numpy as np

from sphere_mapping.acquisition.range.rectification import NUM_VALUES, Matches, correct, epipolar_errors, match_angles
from sphere_nav.geometry import SE3, Fisheye, Rig, RigCamera
from worlds.rig import OPTICAL

PLACE = (800, 600, 240.0, 250.0, 399.5, 299.5)
LENS = Fisheye(*PLACE, (0.02, -0.01, 0.0, 0.0))
SCALE = 0.01


def rig_and_matches(lens, rng):
    poses = [
        SE3.from_parts(OPTICAL, place) @ SE3.exp([0, 0, 0, *rng.normal(0, 0.1, 3)]) for place in rng.normal(size=(3, 3))
    ]
    rig = Rig(tuple(RigCamera(name, lens, pose) for name, pose in zip("abc", poses, strict=True)))
    pixels = rng.uniform((200, 150), (600, 450), (6, 40, 2))
    ranges = np.where(rng.random(40) < 0.2, np.nan, rng.uniform(2, 9, 40))
    pairs = [("a", "b", None), ("b", "c", ranges), ("c", "a", None)]
    return rig, [Matches(i, j, pixels[k], pixels[k + 3], r) for k, (i, j, r) in enumerate(pairs)]


def test_a_match_whose_range_is_unknown_counts_by_its_plane_alone(rng):
    rig, matches = rig_and_matches(LENS, rng)
    found = match_angles(rig, matches, SCALE)
    np.testing.assert_allclose(found[:120] * SCALE, epipolar_errors(rig, matches))
    is_unknown = np.isnan(matches[1].range_first)
    assert (found[120:][is_unknown] == 0).all()
    assert (found[120:][~is_unknown] != 0).all()


def test_a_correction_moves_no_camera_and_shifts_by_shares_of_the_focal_length(rng):
    rig, _ = rig_and_matches(LENS, rng)
    values = np.zeros(3 * NUM_VALUES)
    values[NUM_VALUES : 2 * NUM_VALUES] = 0, 0, 0.01, np.log(1.02), 0.001, -0.002
    found = correct(rig, values)
    assert found.cameras[0].camera == rig.cameras[0].camera
    np.testing.assert_array_equal(found.cameras[0].T_rig_camera.matrix, rig.cameras[0].T_rig_camera.matrix)
    before, after = rig.camera("b"), found.camera("b")
    np.testing.assert_allclose(after.T_rig_camera.translation, before.T_rig_camera.translation)
    turn = before.T_rig_camera.rotation.T @ after.T_rig_camera.rotation
    np.testing.assert_allclose(turn[1, 0], np.sin(0.01))
    np.testing.assert_allclose(after.camera.coefficients[:4], (244.8, 255.0, 399.74, 299.0))
