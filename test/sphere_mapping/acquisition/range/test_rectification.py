"""A rig whose file is a little wrong is put right by what its own cameras see."""

from dataclasses import replace

import numpy as np
import pytest

from sphere_mapping.acquisition.range import rectification
from sphere_mapping.acquisition.range.rectification import NUM_VALUES, Matches, correct, epipolar_errors, rectify
from sphere_nav.geometry import SE3, Fisheye, Rig, RigCamera
from worlds.rig import BASELINE, OPTICAL

LENS = Fisheye(800, 800, 240.0, 240.0, 399.5, 399.5)
NOISE_PX = 0.3


def make_rig():
    places = {"a": (0.0, 0.0), "b": (0.0, -BASELINE), "c": (1.2, 0.0), "d": (1.2, -BASELINE)}
    parts = []
    for name, (azimuth, z) in places.items():
        pose = SE3.from_planar(0.0, 0.0, azimuth) @ SE3.from_parts(OPTICAL, [0.03, 0.0, z])
        parts.append(RigCamera(name, LENS, pose))
    return Rig(tuple(parts))


def matches_in(rig, rng, num_wrong):
    """Points all around, 2 to 12 m away, seen by pairs of cameras with noise; some matches are wrong."""
    rays = rng.normal(size=(1500, 3)) * (1, 1, 0.5)
    points = rays / np.linalg.norm(rays, axis=1, keepdims=True) * rng.uniform(2, 12, (1500, 1))
    seen = {part.name: part.camera.project(part.T_rig_camera.inverse().apply(points)) for part in rig.cameras}
    found = []
    for a, b in (("a", "b"), ("a", "c"), ("b", "d"), ("c", "d"), ("a", "d")):
        both = np.flatnonzero(seen[a][1] & seen[b][1])[:300]
        first, second = (seen[name][0][both] + NOISE_PX * rng.normal(size=(both.size, 2)) for name in (a, b))
        second[:num_wrong] += rng.normal(size=(num_wrong, 2)) * 40
        found.append(Matches(a, b, first, second))
    return found


def disturbed(rig, rng, degrees=0.3):
    return replace(
        rig,
        cameras=tuple(
            replace(
                part, T_rig_camera=part.T_rig_camera @ SE3.exp([0, 0, 0, *rng.normal(size=3) * np.radians(degrees)])
            )
            for part in rig.cameras
        ),
    )


@pytest.mark.slow
def test_turned_cameras_are_turned_back(rng):
    rig = make_rig()
    matches = matches_in(rig, rng, 90)
    good = [Matches(m.first, m.second, m.pixels_first[90:], m.pixels_second[90:]) for m in matches]
    right = epipolar_errors(rig, good)
    found = rectify(disturbed(rig, rng), matches)
    assert found.before_deg > 3 * found.after_deg
    after = epipolar_errors(found.rig, good)
    # as good as the true rig, within what 24 numbers fitted to a thousand matches can do
    assert np.median(np.abs(after)) < 1.1 * np.median(np.abs(right))


def test_a_correction_is_told_by_camera_and_nothing_corrects_nothing(rng, monkeypatch):
    monkeypatch.setattr(rectification, "RECTIFY_SCALES_DEG", (0.4,))  # no match is wrong
    rig = make_rig()
    turned = disturbed(rig, rng)
    matches = [replace(m, pixels_first=m.pixels_first[:40], pixels_second=m.pixels_second[:40])
               for m in matches_in(rig, rng, 0)]  # fmt: skip
    found = rectify(turned, matches)
    assert found.before_deg > 3 * found.after_deg
    for now, was in zip(found.rig.cameras, turned.cameras, strict=True):
        assert found.angle_deg[now.name] == pytest.approx(np.degrees(now.T_rig_camera.distance(was.T_rig_camera)[1]))
    nothing = rectify(turned, [])
    assert (nothing.rig, nothing.angle_deg) == (turned, dict.fromkeys("abcd", 0.0))


def test_a_correction_moves_no_camera_and_shifts_by_shares_of_the_focal_length():
    rig = make_rig()
    values = np.zeros(4 * NUM_VALUES)
    values[NUM_VALUES : 2 * NUM_VALUES] = 0, 0, 0.01, np.log(1.02), 0.001, -0.002
    found = correct(rig, values)
    assert found.cameras[0].camera == rig.cameras[0].camera
    np.testing.assert_array_equal(found.cameras[0].T_rig_camera.matrix, rig.cameras[0].T_rig_camera.matrix)
    before, after = rig.camera("b"), found.camera("b")
    np.testing.assert_allclose(after.T_rig_camera.translation, before.T_rig_camera.translation)
    turn = before.T_rig_camera.rotation.T @ after.T_rig_camera.rotation
    np.testing.assert_allclose(turn[1, 0], np.sin(0.01))
    np.testing.assert_allclose(after.camera.coefficients[:4], (244.8, 244.8, 399.74, 399.02))
