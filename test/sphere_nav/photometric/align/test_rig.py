"""Several cameras of one body: the change of coordinates, one camera as a rig of one, and motions."""

from dataclasses import replace

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Fisheye, FrameMotion, Pinhole, Spherical
from sphere_nav.photometric import PyramidParams, RegistrationParams, View, build_pyramid, prepare_reference
from sphere_nav.photometric.align.descent import kernels
from sphere_nav.photometric.align.esm import register_rig
from sphere_nav.photometric.align.problem import AlignmentState, Problem
from sphere_nav.photometric.align.rig import RigImage, image_overlap
from sphere_nav.photometric.checks.lens import measure_stretches
from sphere_nav.photometric.checks.structure import find_rig_structure
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

PINHOLE = Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5)
FISHEYE = Fisheye(160, 120, 60.0, 60.0, 79.5, 59.5, (0.02, -0.01, 0.0, 0.0))
PARAMS = RegistrationParams(pyramid=PyramidParams(num_levels=3, min_side=24), max_pixels=20_000)
# One camera looks ahead and a little down, the other one back and to the side; both are off the middle of the body.
MOUNTS = (
    SE3.exp([0.4, 0.1, 0.2, 0.0, 0.1, 0.2]) @ T_BODY_OPTICAL,
    SE3.exp([-0.3, -0.2, 0.1, 0.0, 0.0, 2.4]) @ T_BODY_OPTICAL,
)
CAMERAS = PINHOLE, FISHEYE
T_ROOM_BODY = SE3.exp([0.3, -0.2, 0.1, 0.0, 0.0, 0.1])
START = T_ROOM_BODY @ SE3.exp([0.03, -0.04, 0.02, 0.01, -0.01, 0.02])


@pytest.fixture(scope="module")
def views(room):
    places = [SE3.identity(), SE3.from_planar(0.8, 0.1, 0.0)]
    spheres = [room.sphere(T, Spherical(512, 256), k) for k, T in enumerate(places)]
    references = [prepare_reference(one.gray, one.range_m, one.camera, PARAMS) for one in spheres]
    return tuple(View(one, T) for one, T in zip(references, places, strict=True))


def seen(room, k, T_room_body, views):
    """Return what a camera of the body sees."""
    picture = room.photograph(CAMERAS[k], T_room_body @ MOUNTS[k], 50 + k)
    return RigImage(build_pyramid(picture, CAMERAS[k], PARAMS.pyramid), MOUNTS[k], views, f"camera{k}")


@pytest.fixture(scope="module")
def images(room, views):
    return tuple(seen(room, k, T_ROOM_BODY, views) for k in range(2))


def test_the_increment_of_a_camera_is_the_adjoint_of_that_of_the_body(images):
    problem, state = Problem.choose_pixels(images, 1, START, PARAMS), AlignmentState.start(START, 4)
    H, g, found = problem.compare(state)
    visible = sum(one.num_visible for one in found)
    for image in images:
        step = 1e-6 * np.eye(6)
        X, start = image.T_body_camera, image.pose(START)
        numeric = np.stack([(X.inverse() @ SE3.exp(xi) @ X).log() for xi in step], axis=1) / 1e-6
        moved = image.motion(FrameMotion(START @ SE3.exp(np.full(6, -0.05)), 0.5)).twist(start)
        np.testing.assert_allclose(moved, 0.025 * numeric.sum(axis=1), atol=1e-6)  # within a frame, too
        one = Problem.choose_pixels([replace(image, T_body_camera=None)], 1, start, PARAMS)
        h, q, found = one.compare(AlignmentState.start(start, 2))
        H[:6, :6] -= numeric.T @ h[:6, :6] @ numeric
        g[:6] -= numeric.T @ q[:6]
        visible -= sum(view.num_visible for view in found)
    np.testing.assert_allclose(H[:6, :6], 0.0, atol=1e-4 * np.abs(h[:6, :6]).max())
    np.testing.assert_allclose(g[:6], 0.0, atol=1e-4 * np.abs(q[:6]).max())
    assert visible == 0
    assert H.shape == (14, 14)
    assert np.all(H[6:10, 10:] == 0.0)  # the light of one camera says nothing of the other's
    T_camera_body = np.ascontiguousarray(X.inverse().matrix[:3])
    xi = X.adjoint() @ [0.3, 0.0, 0.4, 0.0, 0.6, 0.8]
    assert kernels.image_motion(xi, T_camera_body, 100.0, 4.0) == pytest.approx(100.0 * (1.0 + 0.5 / 4.0))


def test_two_cameras_find_their_motion(images):
    found = register_rig(images, START, PARAMS)
    assert found.is_converged
    assert len(found.gains) == 4
    meters, radians = found.T_world_camera.distance(T_ROOM_BODY)
    assert meters < 0.003  # noise of 2 grey levels: each camera alone errs by 2 to 4 mm
    assert radians < 0.0015
    xi = (found.T_world_camera.inverse() @ T_ROOM_BODY).log()
    assert xi @ np.linalg.solve(found.covariance, xi) < 25.0  # 6 degrees of freedom, 1 in 3000
    assert find_rig_structure(images, found, PARAMS).agreement > 0.5
    lenses, _ = measure_stretches(images, found, PARAMS)
    assert [one.camera for one in lenses] == [image.name for image in images]
    assert max(abs(one.share) for one in lenses) < 0.02


TWO_LEVELS = RegistrationParams(pyramid=PyramidParams(num_levels=2, min_side=8))


def overlap(range_m, turn=0.0):
    image = np.zeros((120, 160), np.uint8)
    view = View(prepare_reference(image, range_m, PINHOLE, TWO_LEVELS), SE3.identity())
    cameras = build_pyramid(image, PINHOLE, TWO_LEVELS.pyramid).cameras
    return image_overlap(cameras, [view], SE3.exp([0, 0, 0, 0, turn, 0]))


def test_what_comes_into_view_or_has_no_range_is_not_covered():
    range_m = np.full((120, 160), 3.0, np.float32)
    assert overlap(range_m) > 0.95  # all but its border
    assert 0.35 < overlap(range_m, turn=np.arctan(80 / 110)) < 0.6  # by half of the field of view
    assert overlap(range_m, turn=np.pi) == 0.0
    range_m[:, 80:] = np.nan
    assert abs(overlap(range_m) - 0.5) < 0.05
