"""Height, roll and pitch of a camera on a vehicle, by where another vehicle was taught."""

import numpy as np
import pytest

from dense_localizer.constants import GROUND_SIGMA
from dense_localizer.references.ground import Ground
from sphere_nav.geometry import SE3
from sphere_nav.photometric.align.problem import NO_EXPECTATION
from sphere_nav.spheres.graph import Experience, KeySphere, SphereGraph
from sphere_nav.spheres.sphere import T_BODY_OPTICAL

T_BASE_SPHERE = SE3.from_angles(0.0, 0.05, 0.0, [0.6, 0.0, 1.8])
T_BASE_CAMERA = SE3.from_angles(0.0, 0.1, 0.3, [1.2, 0.1, 0.4]) @ T_BODY_OPTICAL


def ground_of(bases, T_base_sphere=T_BASE_SPHERE, T_base_body=T_BASE_CAMERA):
    """Return the ground of a map that was taken at these poses of the base."""
    T_told = T_base_sphere or SE3.identity()
    ground = Ground(SphereGraph(KeySphere(k, 1 + k, T @ T_told) for k, T in enumerate(bases)), T_base_sphere)
    ground.T_base_body = T_base_body
    return ground


def climb(slope_rad, start=0):
    """Return poses of the base, two metres apart, on a slope from one of them on."""
    T, poses = SE3.identity(), []
    for k in range(8):
        pitch = -slope_rad if k >= start else 0.0
        poses.append(SE3.from_angles(0.0, pitch, 0.0, T.translation))
        T = poses[-1] @ SE3.from_planar(2.0, 0.0, 0.0)
    return poses


@pytest.mark.parametrize("yaw", [0.0, 0.4, np.pi])
@pytest.mark.parametrize("slope", [0.0, 0.08])
def test_the_camera_is_as_high_and_as_tilted_as_on_the_taught_vehicle_wherever_that_heads(yaw, slope):
    bases = climb(slope, start=1)
    ground = ground_of(bases)
    T_map_base = bases[5] @ SE3.from_planar(0.3, -0.8, yaw)
    off = SE3.exp([0.0, 0.0, 0.07, 0.02, -0.03, 0.0])  # of the base: too high, and tilted
    expected = ground.expect(T_map_base @ off @ T_BASE_CAMERA)
    there = (T_map_base @ T_BASE_CAMERA).inverse() @ expected.T_world_body
    assert there.distance(SE3.identity()) < (2e-3, 1e-3)
    A = T_BASE_CAMERA.inverse().adjoint()
    np.testing.assert_allclose(A.T @ expected.information @ A, np.diag([0, 0, *ground.sigma**-2, 0]), atol=1e-6)


def test_a_camera_of_several_stands_as_the_body_does():
    ground, T_body_camera = ground_of(climb(0.0), T_base_body=SE3.identity()), T_BASE_CAMERA
    pose = SE3.from_planar(3.0, 0.2, 0.5)
    body, camera = ground.expect(pose), ground.expect(pose @ T_body_camera, T_body_camera)
    assert camera.T_world_body.distance(body.T_world_body @ T_body_camera) < (1e-9, 1e-9)
    A = T_body_camera.adjoint()
    np.testing.assert_allclose(camera.information, A.T @ body.information @ A, atol=1e-6)


def test_how_even_the_ground_is_the_taught_vehicle_tells():
    np.testing.assert_allclose(ground_of(climb(0.0)).sigma, GROUND_SIGMA)
    np.testing.assert_allclose(ground_of(climb(0.1)).sigma, GROUND_SIGMA)
    by_hand = np.random.default_rng(3).normal(0.0, [0.0, 0.0, 0.05, 0.01, 0.03, 0.0], (8, 6))
    steps = np.diff(by_hand, axis=0)[:, 2:5]
    steps[:, 0] += 2.0 * by_hand[:-1, 4]  # who looks down sees the next, two metres ahead, higher
    differ = np.sqrt(np.mean(steps**2, axis=0))
    sigma = ground_of([T @ SE3.exp(xi) for T, xi in zip(climb(0.0), by_hand, strict=True)]).sigma
    np.testing.assert_allclose(sigma, np.maximum(differ, GROUND_SIGMA), rtol=0.02)
    assert np.all(sigma > 1.5 * GROUND_SIGMA)


def test_nothing_is_expected_of_a_hand_held_map_or_where_nobody_tells_the_mounting():
    rng = np.random.default_rng(4)
    by_hand = [T @ SE3.exp(rng.normal(0.0, [0.1, 0.1, 0.1, 0.05, 0.05, 0.3])) for T in climb(0.0)]  # differ by 0.08
    for ground in (
        ground_of(by_hand),
        ground_of(climb(0.0), T_base_sphere=None),
        ground_of(climb(0.0), T_base_body=None),
    ):
        assert ground.expect(SE3.identity()) is NO_EXPECTATION
    lower = T_BASE_CAMERA.translation[2] - T_BASE_SPHERE.translation[2]
    heights = [ground_of(climb(0.0), one).height_above(T_BASE_CAMERA) for one in (None, T_BASE_SPHERE)]
    assert heights == pytest.approx([0.0, lower], abs=0.1)  # of spheres that nobody has told the place of


def test_another_drive_in_the_map_says_nothing_by_its_own_mount_nor_does_a_place_far_away():
    first = [KeySphere(k, 1 + k, T @ T_BASE_SPHERE) for k, T in enumerate(climb(0.0))]
    other = KeySphere(
        20, 99, SE3.from_planar(40.0, 0.0, 1.0) @ SE3.exp([0, 0, 9.0, 0, 0, 0]), experience=Experience("dusk")
    )
    near = KeySphere(21, 0, SE3.from_planar(4.0, 0.5, 1.0), experience=Experience("dusk"))
    ground, alone = Ground(SphereGraph([*first, other, near]), T_BASE_SPHERE), ground_of(climb(0.0))
    ground.T_base_body = T_BASE_CAMERA
    np.testing.assert_allclose(ground.sigma, alone.sigma)
    pose = SE3.from_planar(4.0, 0.4, 0.2) @ T_BASE_CAMERA
    assert ground.expect(pose).T_world_body.distance(alone.expect(pose).T_world_body) == (0.0, 0.0)
    assert ground.expect(SE3.from_planar(40.0, 0.0, 0.0) @ T_BASE_CAMERA) is NO_EXPECTATION
