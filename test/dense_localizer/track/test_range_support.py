"""Depth where images do not do: by night, in new light, beside a lamp; and what it must not do."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from dense_localizer.inputs import CameraImage
from dense_localizer.judge.candidate import Acceptance, PoseCandidate
from dense_localizer.motion_prior import Prediction
from dense_localizer.params import LocalizerParams
from dense_localizer.track.range_support import RangeSupport, join
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.localization.status import FINE, Reason
from sphere_nav.spheres.graph import KeySphere
from sphere_nav.spheres.range_alignment import DepthImage
from worlds.localizer import PINHOLE, STEP_NS, at, drive, error, make_localizer

DEPTH_CAMERA = Pinhole(128, 96, 90.0, 90.0, 63.5, 47.5)
T_IMAGE_DEPTH = SE3.exp([0.05, 0.01, -0.02, 0.0, 0.03, 0.02])
SLIP = SE3.exp([0.02, 0.01, 0.0, 0.0, 0.01, 0.0])
BLACK = np.zeros((PINHOLE.height, PINHOLE.width), np.uint8)
NOISE = 0.004  # of the depth


class DepthRun:
    def __init__(self, room, localizer):
        self.room, self.localizer, self.count, self.stamp_ns = room, localizer, 0, 1_000_000_000

    def depth(self, T_room_camera):
        depth_m = self.room.rgbd(DEPTH_CAMERA, T_room_camera @ T_IMAGE_DEPTH)[1]
        rough = depth_m * (1.0 + NOISE * np.random.default_rng(self.count).normal(size=depth_m.shape))
        return DepthImage(rough, DEPTH_CAMERA, T_IMAGE_DEPTH)

    def see(self, T_room_camera, image=None, depth=None, **mounted):
        self.count, self.stamp_ns = self.count + 1, self.stamp_ns + STEP_NS
        image = self.room.photograph(PINHOLE, T_room_camera, self.count) if image is None else image
        one = CameraImage(image, PINHOLE, depth=self.depth(T_room_camera) if depth is None else depth)
        return self.localizer.update_rig((replace(one, **mounted),), self.stamp_ns)


@pytest.fixture
def run(room, room_map):
    return DepthRun(room, make_localizer(room_map))


def test_of_all_key_spheres_that_a_depth_image_fits_the_likeliest_places_it(monkeypatch):
    likeness = {1: 0.3, 2: 0.7, 3: 0.5}
    nodes = [KeySphere(one, one, SE3.from_planar(float(one), 0.0, 0.0)) for one in likeness]

    def measure(one, image, T_guess):
        return SimpleNamespace(likeness=likeness[one], T_a_b=T_guess @ SLIP, covariance=np.eye(6))

    monkeypatch.setattr("dense_localizer.track.range_support.measure_motion_by_ranges", measure)
    by_map = np.diag([4.0, 1.0, 2.0, 0.5, 3.0, 6.0])
    error = SimpleNamespace(covariance=lambda *_: by_map)
    support = RangeSupport(SimpleNamespace(covering=lambda *_: nodes, error=error), LocalizerParams())
    monkeypatch.setattr(support, "_range_of", lambda one: one)
    depth = DepthImage(np.ones((96, 128)), DEPTH_CAMERA, T_IMAGE_DEPTH)
    fit, T_map_body, covariance = support._place(depth, at(0.5, 0.0, 0.3))
    assert fit.likeness == 0.7
    expected = at(0.5, 0.0, 0.3) @ T_IMAGE_DEPTH @ SLIP @ T_IMAGE_DEPTH.inverse()
    np.testing.assert_allclose(T_map_body.matrix, expected.matrix, atol=1e-12)
    Ad = T_IMAGE_DEPTH.adjoint()
    np.testing.assert_allclose(covariance, Ad @ (np.eye(6) + by_map) @ Ad.T, atol=1e-12)


@pytest.mark.slow
def test_depth_of_a_camera_on_a_body_places_the_body(run):
    T_body_camera = SE3.exp([0.3, -0.1, 0.2, 0.0, 0.2, 0.1])
    way = drive(14, speed=0.5)
    for k, pose in enumerate(way):
        estimate = run.see(pose, BLACK if k >= 10 else None, T_body_camera=T_body_camera)
    assert estimate.candidate.is_by_range
    assert error(estimate, way[-1] @ T_body_camera.inverse())[0] < 0.015


def test_without_depth_a_black_image_is_no_pose(run):
    way = drive(20, speed=0.5)
    nothing = DepthImage(np.full((96, 128), np.nan), DEPTH_CAMERA, T_IMAGE_DEPTH)
    for k, pose in enumerate(way):
        estimate = run.see(pose, *((BLACK, nothing) if k >= 8 else ()))
    assert estimate.T_map_camera is None
    assert estimate.status.reason == Reason.LOW_TEXTURE


@pytest.mark.slow
def test_frozen_depth_holds_no_pose(run):
    way = drive(24, speed=0.5)
    for pose in way[:8]:
        run.see(pose)
    frozen = run.depth(way[8])
    for pose in way[8:]:
        estimate = run.see(pose, BLACK, frozen)
    assert estimate.T_map_camera is None


@pytest.fixture
def support(room_map):
    localizer = make_localizer(room_map)
    return RangeSupport(localizer.references, localizer.params)


@pytest.mark.parametrize(("off_m", "is_joined"), [(0.03, True), (0.3, False)])
def test_a_pose_with_care_is_joined_or_geometry_holds(run, support, off_m, is_joined):
    pose, off = at(0.2, 0.1, 0.2), SE3.exp([off_m, 0.0, 0.0, 0.0, 0.0, 0.0])
    frame = run.localizer._inputs.check((CameraImage(BLACK, PINHOLE, depth=run.depth(pose)),), 10**9)
    acceptance = Acceptance(is_accepted=True, is_good=False, finding=FINE, quality=0.1)
    prediction = Prediction(pose, 0.05**2 * np.eye(6), 1)
    given = PoseCandidate(pose @ off, 0.02**2 * np.eye(6), prediction, None, acceptance)
    found = support.support(frame.depth, given)
    assert (found.acceptance.is_good, found.is_by_range) == (True, not is_joined)
    assert found.T_map_camera.distance(pose)[0] < 0.5 * 0.03
    assert np.trace(found.covariance) < np.trace(given.covariance)


def test_two_poses_are_joined_as_information_adds():
    rng = np.random.default_rng(4)
    roots = [rng.normal(size=(6, 6)) * scale for scale in (0.01, 0.03)]
    a, b = (root @ root.T + 1e-6 * np.eye(6) for root in roots)
    xi = rng.normal(size=6) * 0.01
    T, joint, apart = join(SE3.identity(), a, SE3.exp(xi), b)
    np.testing.assert_allclose(np.linalg.inv(joint), np.linalg.inv(a) + np.linalg.inv(b), rtol=1e-6)
    np.testing.assert_allclose(T.log(), joint @ np.linalg.solve(b, xi), atol=1e-9)
    assert apart == pytest.approx(np.sqrt(xi @ np.linalg.solve(a + b, xi)))
