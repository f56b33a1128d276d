"""A rig whose file is a little wrong is put right by what its own cameras see."""

from dataclasses import replace

import numpy as np
import pytest

from sphere_mapping.acquisition.range import rectification
from sphere_mapping.acquisition.range.rectification import (
    NUM_VALUES,
    Matches,
    correct,
    epipolar_errors,
    match_angles,
    rectify,
)
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
    assert set(found.angle_deg) == {"a", "b", "c", "d"}


def test_known_ranges_tell_turns_that_epipolar_planes_do_not(rng, monkeypatch):
    """Two cameras side by side look the same way: a turn about the axis across both moves all along the lines."""
    monkeypatch.setattr(rectification, "RECTIFY_SCALES_DEG", (0.15,))  # no match is wrong
    poses = [SE3.from_parts(OPTICAL, [0.0, y, 0.0]) for y in (0.25, -0.25)]
    rig = Rig(tuple(RigCamera(name, LENS, pose) for name, pose in zip("ab", poses, strict=True)))
    ahead = rng.uniform(4, 12, (60, 1))
    points = np.hstack([ahead, ahead * rng.uniform(-0.1, 0.1, (60, 2))])  # a narrow view: the lines are parallel
    seen = [part.T_rig_camera.inverse().apply(points) for part in rig.cameras]
    pixels = [LENS.project(p)[0] + 0.1 * rng.normal(size=(60, 2)) for p in seen]
    ranges = np.linalg.norm(seen[0], axis=1) * rng.normal(1.0, 0.05, 60)
    ranges[::3] = np.nan
    turned = replace(
        rig,
        cameras=(rig.cameras[0], replace(rig.cameras[1], T_rig_camera=poses[1] @ SE3.exp([0, 0, 0, 0.005, 0.01, 0]))),
    )

    def error_of(found):
        now = found.rig.cameras[0].T_rig_camera.inverse() @ found.rig.cameras[1].T_rig_camera
        there = found.rig.cameras[1].camera.project(now.inverse().apply(seen[0]))[0]
        return np.median(np.linalg.norm(there - pixels[1], axis=1))

    blind = rectify(turned, [Matches("a", "b", *pixels)])
    told = rectify(turned, [Matches("a", "b", *pixels, ranges)])
    assert error_of(blind) > 1.5  # 0.01 rad are 2.4 px
    assert error_of(told) < 1.0  # ranges are good to 5 %, and the rig file still has its say
    for found in (blind, told):
        assert found.before_deg > np.degrees(0.004)
        assert found.after_deg < 0.025  # the noise
        for now, was in zip(found.rig.cameras, turned.cameras, strict=True):
            angle = now.T_rig_camera.distance(was.T_rig_camera)[1]
            assert found.angle_deg[now.name] == pytest.approx(np.degrees(angle))
    nothing = rectify(turned, [])
    assert (nothing.rig, nothing.angle_deg) == (turned, {"a": 0.0, "b": 0.0})


PLACE = (800, 600, 240.0, 250.0, 399.5, 299.5)
BENT_LENS = Fisheye(*PLACE, (0.02, -0.01, 0.0, 0.0))
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
    rig, matches = rig_and_matches(BENT_LENS, rng)
    found = match_angles(rig, matches, SCALE)
    np.testing.assert_allclose(found[:120] * SCALE, epipolar_errors(rig, matches))
    is_unknown = np.isnan(matches[1].range_first)
    assert (found[120:][is_unknown] == 0).all()
    assert (found[120:][~is_unknown] != 0).all()


def test_a_correction_moves_no_camera_and_shifts_by_shares_of_the_focal_length(rng):
    rig, _ = rig_and_matches(BENT_LENS, rng)
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
