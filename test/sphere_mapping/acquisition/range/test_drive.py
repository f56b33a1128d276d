from dataclasses import replace

import numpy as np
import pytest

from sphere_mapping.acquisition.params import MatchParams
from sphere_mapping.acquisition.range.drive import DriveRange, PlacedSphere, motion_variance, range_by_drive, shrinking
from sphere_nav.geometry import SE3, Spherical
from worlds.room import sharp_room

CAMERA = Spherical(512, 256)
ROOM = sharp_room((3.0, 2.5, 1.5))
POSES = [SE3.exp([-0.2 * k, 0.02 * k, 0.0, 0.0, 0.0, 0.03 * k]) for k in range(3)]  # the drive, backwards
KNOWN = np.broadcast_to(np.arange(512) % 16 < 8, (256, 512))  # stripes that the instant has measured
SURE = np.diag(np.repeat([0.002, 0.0005], 3) ** 2)
PARAMS = MatchParams(noise=1.0, nearest_m=1.2)


@pytest.fixture(scope="module")
def drive():
    """The last sphere, of which half has a range; earlier ones; the true range; what the drive says."""
    rng = np.random.default_rng(0)
    spheres = [ROOM.sphere(pose, CAMERA) for pose in POSES]
    noisy = [np.clip(one.image + rng.normal(0, 1, one.image.shape), 1, 255).astype(np.uint8) for one in spheres]
    nothing, truth = np.full((256, 512), np.nan, np.float32), spheres[0].range_m
    half, std = nothing.copy(), nothing.copy()
    half[KNOWN], std[KNOWN] = truth[KNOWN], 0.005
    last = replace(spheres[0], image=noisy[0], range_m=half, range_std_m=std)
    earlier = [replace(one, image=image) for one, image in zip(spheres[1:], noisy[1:], strict=True)]
    placed = [PlacedSphere(one, pose, SURE) for one, pose in zip(earlier, POSES[1:], strict=True)]
    return last, placed, truth, range_by_drive(last, placed, PARAMS)


def test_what_the_instant_does_not_measure_the_drive_does_with_an_honest_deviation(drive):
    _, _, truth, (range_m, std_m) = drive
    assert np.isnan(range_m[KNOWN]).all()  # the present decides
    is_new = np.isfinite(range_m)
    assert is_new.mean() > 0.1  # of half of the directions
    off = np.abs(range_m - truth)[is_new]
    assert np.mean(off > 3 * std_m[is_new]) < 0.02
    assert np.mean(off > 0.1 * truth[is_new]) < 0.01
    assert np.median(off / truth[is_new]) < 0.02


def test_what_is_bare_or_moves_with_the_rig_is_not_measured(drive):
    last, earlier, _, (right, _) = drive
    assert np.isfinite(right[106:150, 336:414]).mean() > 0.2
    rows, columns = slice(100, 156), slice(330, 420)
    for fill in (np.uint8(90), np.random.default_rng(1).integers(60, 200, (56, 90)).astype(np.uint8)):
        spoiled = []
        for one in (last, *(placed.sphere for placed in earlier)):
            image = one.image.copy()
            image[rows, columns] = fill
            spoiled.append(replace(one, image=image))
        again = [replace(placed, sphere=one) for placed, one in zip(earlier, spoiled[1:], strict=True)]
        found, _ = range_by_drive(spoiled[0], again, PARAMS)
        inside = found[106:150, 336:414]
        assert np.isnan(inside).mean() > 0.98


def test_a_wrong_motion_is_refuted_by_what_the_instant_measured(drive):
    last, earlier, _, (right, _) = drive
    wrong = [replace(one, T=one.T @ SE3.exp([0, 0, 0, 0, 0.05, 0.05])) for one in earlier]
    found, _ = range_by_drive(last, wrong, PARAMS)
    assert np.isfinite(found).sum() < 0.2 * np.isfinite(right).sum()
    assert np.isnan(range_by_drive(last, earlier[:1], PARAMS)[0]).all()  # one alone could have seen what moved


def test_the_variance_of_a_motion_is_what_a_wrong_motion_makes_of_inverse_range():
    rng, ray, x = np.random.default_rng(2), np.array([0.36, 0.48, 0.8]), 0.4
    T, step = SE3.exp([0.3, -0.1, 0.05, 0.1, -0.05, 0.2]), 1e-5
    seen = T.rotation.T @ (ray - x * T.translation)
    A = rng.normal(size=(6, 6))
    J = np.empty(6)
    for k in range(6):
        moved = T @ SE3.exp(step * np.eye(6)[k])
        # the inverse range at which the wrong pose sees the ray nearest to where the true one does
        tried = x + np.linspace(-1e-3, 1e-3, 4001)
        points = (ray - tried[:, None] * moved.translation) @ moved.rotation
        points /= np.linalg.norm(points, axis=1)[:, None]
        distance = np.sum((points - seen / np.linalg.norm(seen)) ** 2, axis=1)
        J[k] = -np.polyfit(tried - x, distance, 2) @ [0, 1, 0] / (2 * np.polyfit(tried - x, distance, 2)[0]) / step
    covariance = 1e-6 * A @ A.T
    placed = PlacedSphere(None, T, covariance)
    found = motion_variance(ray[None, None], np.array([[x]]), [placed])
    assert found[0, 0] == pytest.approx(J @ covariance @ J, rel=0.3)  # the ray's own frame, to first order in x t


def test_a_drive_keeps_spheres_that_are_apart_and_follows_the_map(drive):
    last, earlier, _, (right, _) = drive
    kept, T_map = DriveRange(PARAMS), SE3.exp([5.0, 3.0, 1.0, 0.1, 0.2, 2.0])
    assert kept.filled() is None
    for one in reversed(earlier):
        kept.add(one.sphere, one.T, SURE)
        kept.add(one.sphere, one.T, SURE)  # the vehicle stands
    kept.transform(T_map)
    kept.add(last, T_map, np.zeros((6, 6)))
    found = kept.filled().range_m
    is_new = np.isfinite(found) & ~KNOWN
    np.testing.assert_allclose(found[is_new], right[is_new], rtol=1e-3)
    assert is_new.sum() == np.isfinite(right).sum()
    np.testing.assert_array_equal(found[KNOWN], last.range_m[KNOWN])
    kept.add(replace(last, range_std_m=None), T_map, SURE)
    assert kept.filled().range_std_m is None  # nothing is added to what has no deviation


def test_spheres_of_any_size_are_shrunk_to_whole_pixels():
    assert [shrinking(Spherical(2 * rows, rows)) for rows in (128, 512, 832, 1024)] == [1, 2, 2, 4]
