"""The pose of a depth camera beside the image's is found from pairs of a drive in a room."""

from dataclasses import replace

import numpy as np
import pytest

from rig_calibration.drive.depth_pair import DepthPair, differentiate_pair
from rig_calibration.drive.depth_pixels import make_frame, without_hidden
from rig_calibration.drive.depth_pose import refine_depth_pose
from rig_calibration.drive.drive_image import ImageState
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from worlds.room import sharp_room

CAMERA = Pinhole(240, 180, 190.0, 191.0, 121.0, 88.0, (-0.05, 0.01, 0.0, 0.0))
DEPTH = Pinhole(240, 180, 215.0, 215.0, 119.0, 91.0)
TRUTH = SE3.exp([-0.03, 0.004, -0.006, 0.01, -0.008, 0.012])
START = SE3.exp([0.012, 0.012, -0.011, 0.010, 0.011, -0.009]) @ TRUTH  # 20 mm, 1 deg off
ROOM = sharp_room((2.0, 1.6, 1.2), 0.2)


def frame(T_room_camera, rng, twist=None, T_image_depth=TRUTH):
    twist = np.zeros(6) if twist is None else twist
    gray = ROOM.render_rolling(CAMERA, T_room_camera, twist) + rng.normal(0, 2.0, (CAMERA.height, CAMERA.width))
    back = T_image_depth.inverse()
    depth_twist = back.adjoint() @ twist
    range_m = ROOM.range_rolling(DEPTH, T_room_camera @ T_image_depth, depth_twist)
    depth_m = range_m * DEPTH.unproject(pixel_grid(DEPTH))[..., 2] * (1 + 0.002 * rng.normal(size=range_m.shape))
    return make_frame(np.clip(gray, 0, 255).astype(np.uint8), depth_m, CAMERA, DEPTH, twist)


def drive(number, seed=0, motion=(0.2, 0.2, 0.2, 0.06, 0.06, 0.06), speed=0.0):
    """Pairs with motions that are known to 3 mm and 0.2 deg."""
    rng, pairs = np.random.default_rng(seed), []
    for _ in range(number):
        first = SE3.exp(rng.normal(size=6) * (0.4, 0.4, 0.1, 0.2, 0.2, 1.5)) @ T_BODY_OPTICAL
        step = SE3.exp(rng.normal(size=6) * motion)
        frames = [frame(T, rng, speed * rng.normal(size=6)) for T in (first, first @ step)]
        pairs.append(DepthPair(*frames, step.inverse() @ SE3.exp(0.003 * rng.normal(size=6))))
    return pairs


@pytest.mark.slow
def test_a_start_20_mm_and_1_deg_off_is_mended():
    pairs = [without_hidden(pair, CAMERA, START) for pair in drive(12)]
    found = refine_depth_pose(pairs, CAMERA, START)
    off = (found.T_image_depth @ TRUTH.inverse()).log()
    assert np.linalg.norm(off[:3]) < 0.008
    assert np.linalg.norm(off[3:]) < np.radians(0.15)
    assert off @ np.linalg.solve(found.covariance, off) < 30.0  # chi^2 of 6, told by twelve pairs only
    assert found.unobserved == ()
    assert found.contradicts(START)
    assert not found.contradicts(TRUTH)


@pytest.mark.slow
def test_without_motion_nothing_is_told():
    pairs = drive(8, motion=np.zeros(6))
    assert set(refine_depth_pose(pairs, CAMERA, START, levels=(1,)).unobserved) == {"x", "y", "z", "rx", "ry", "rz"}


@pytest.mark.slow
@pytest.mark.parametrize("speed", [0.0, 0.02])
def test_residuals_have_the_derivatives_that_are_told(speed):
    (pair,) = drive(1, speed=speed)
    state = ImageState(pair.T_second_first, 1.1, -3.0)
    planes = [np.add.outer(a * np.arange(180.0), b * np.arange(240.0)) for a, b in ((1.0, 2.0), (-1.5, 0.7))]
    frames = [  # bilinear is exact
        replace(source, levels=(plane.astype(np.float32),))
        for source, plane in zip((pair.first, pair.second), planes, strict=True)
    ]
    pair = keep_inner(replace(pair, first=frames[0], second=frames[1]))
    _, J = differentiate_pair(pair, state, TRUTH, CAMERA, 0)
    for k in range(14):
        step, size = np.zeros(14), 1e-5 if k < 12 else 1e-3
        step[k] = size
        after, before = (
            differentiate_pair(
                slide(pair, SE3.exp(s * step[:6])), state.moved(s * step[6:]), SE3.exp(s * step[:6]) @ TRUTH, CAMERA, 0
            )[0]
            for s in (1.0, -1.0)
        )
        numeric, scale = (after - before) / (2 * size), np.abs(J[:, k]).max() + 1e-9
        # That a shift of the rows changes their time is left out.
        assert np.percentile(np.abs(numeric - J[:, k]), 99) < (0.1 if speed else 1e-3) * scale


def slide(pair, moved):
    """The points where the planes of a depth camera that moved meet the rays of the same pixels."""
    frames = []
    for source in (pair.first, pair.second):
        rays = TRUTH.apply(source.points_depth)
        normals = source.normals_depth @ (moved @ TRUTH).rotation.T
        on_plane = moved.apply(rays)
        there = rays * (np.sum(normals * on_plane, axis=1) / np.sum(normals * rays, axis=1))[:, None]
        frames.append(replace(source, points_depth=(moved @ TRUTH).inverse().apply(there)))
    return replace(pair, first=frames[0], second=frames[1])


def keep_inner(pair):
    """The points that stay in both images."""
    kept = []
    for source, T in ((pair.first, pair.T_second_first), (pair.second, pair.T_second_first.inverse())):
        is_in = np.ones(len(source.points_depth), bool)
        for T_camera in (TRUTH, T @ TRUTH):
            pixels, inside = CAMERA.project(T_camera.apply(source.points_depth))
            is_in &= inside & np.all((pixels > 12) & (pixels < (228, 168)), axis=1)
        kept.append(replace(source, points_depth=source.points_depth[is_in], normals_depth=source.normals_depth[is_in]))
    return replace(pair, first=kept[0], second=kept[1])
