"""Where a camera sits on the vehicle: laws, recovery, honesty."""

import numpy as np
import pytest

from rig_calibration.drive.mounting import NAMES, find_mounting
from sphere_nav.geometry import SE3

CAMERA = SE3.from_angles(0.03, 0.12, -0.2, [0.7, -0.15, 1.3])
SCALES = np.array([1.02, 0.97])


def drive(rng, *, is_flat=True, turns=1.0, count=400, noise_m=0.0, noise_rad=0.0, scales=(1.0, 1.0), camera=CAMERA):
    """Poses of camera and base: 20 m in bends, on a plane or not; odometry with noise at each step and scales."""
    T_world_base, T_odom_base = [SE3.identity()], [SE3.identity()]
    for k in range(count):
        turn = turns * 0.02 * np.sin(0.05 * k)
        others = [0.0, 0.0] if is_flat else [0.01 * np.sin(0.11 * k), 0.012 * np.cos(0.07 * k)]
        step = np.array([0.05, 0.0, 0.0, *others, turn])
        T_world_base.append(T_world_base[-1] @ SE3.exp(step))
        noisy = step + np.concatenate([rng.normal(0, noise_m, 3), rng.normal(0, noise_rad, 3)])
        noisy /= np.repeat(scales, 3)
        T_odom_base.append(T_odom_base[-1] @ SE3.exp(noisy))
    base = SE3(np.stack([T.matrix for T in T_world_base]))
    T_map_world = SE3.from_angles(0.1, -0.2, 2.0, [3.0, 4.0, 1.0])
    return T_map_world @ base @ camera, SE3(np.stack([T.matrix for T in T_odom_base]))


GIVEN = SE3.from_angles(0.0, 0.0, 0.0, [0.5, 0.0, 1.2])


def test_a_drive_over_bumps_tells_all():
    found = find_mounting(*drive(np.random.default_rng(1), is_flat=False, scales=SCALES), GIVEN)
    assert found.T_base_camera.matrix == pytest.approx(CAMERA.matrix, abs=2e-3)  # pieces that do not bend evenly
    assert found.scales == pytest.approx(SCALES, abs=1e-3)
    assert found.unobserved == ()


def test_a_camera_that_looks_back_is_found_without_a_start():
    camera = SE3.from_angles(0.0, 0.1, np.pi, [-0.4, 0.2, 0.8])
    found = find_mounting(*drive(np.random.default_rng(2), camera=camera, noise_m=1e-3, noise_rad=5e-4))
    off = found.T_base_camera.translation - camera.translation
    assert found.unobserved == ("z",)
    assert np.abs(off[:2]).max() < 0.05
    assert np.linalg.norm((camera.inverse() @ found.T_base_camera).log()[3:]) < 0.01


def test_a_plane_does_not_show_the_height_which_stays_as_given():
    found = find_mounting(*drive(np.random.default_rng(3), noise_m=1e-3, noise_rad=5e-4), GIVEN)
    assert found.unobserved == ("z",)
    assert found.T_base_camera.translation[2] == pytest.approx(1.2, abs=0.1)
    assert found.T_base_camera.translation[:2] == pytest.approx(CAMERA.translation[:2], abs=0.05)


def test_a_straight_drive_does_not_show_the_place():
    found = find_mounting(*drive(np.random.default_rng(4), turns=0.0, noise_m=1e-3, noise_rad=5e-4), CAMERA)
    assert {"x", "y", "z", "roll"} <= set(found.unobserved)
    assert not {"pitch", "yaw"} & set(found.unobserved)


def test_a_straight_drive_turns_a_camera_that_looks_aside_about_what_it_tells_alone():
    given, tilt = SE3.from_angles(0.0, 0.0, 1.4, [0.5, 0.0, 1.2]), SE3.exp([0.0, 0.0, 0.0, 0.0, 0.05, 0.0])
    camera = SE3.from_parts(tilt.rotation @ given.rotation, given.translation)
    found = find_mounting(*drive(np.random.default_rng(6), turns=0.0, camera=camera), given).T_base_camera
    assert found.matrix == pytest.approx(camera.matrix, abs=0.005)


@pytest.mark.slow
def test_deviations_are_those_of_the_errors():
    off = []
    for seed in range(30):
        found = find_mounting(
            *drive(np.random.default_rng(100 + seed), is_flat=False, noise_m=2e-3, noise_rad=1e-3, count=200), CAMERA
        )
        step = np.array([*(found.T_base_camera.translation - CAMERA.translation), *np.zeros(3), *(found.scales - 1.0)])
        step[3:6] = (found.T_base_camera @ CAMERA.inverse()).log()[3:]
        off.append(step / found.deviations)
    rms = np.sqrt(np.mean(np.square(off), axis=0))
    assert np.all((rms > 0.6) & (rms < 1.7)), dict(zip(NAMES, rms, strict=True))


def test_wheels_that_slip_now_and_then_do_not_matter():
    rng = np.random.default_rng(5)
    poses, odometry = drive(rng, is_flat=False, noise_m=1e-3, noise_rad=5e-4)
    matrices = odometry.matrix.copy()
    for k in (90, 210, 330):
        T = SE3(matrices[k]) @ SE3.from_planar(0.4, 0.0, 0.1) @ SE3(matrices[k]).inverse()
        matrices[k:] = (T @ SE3(matrices[k:])).matrix
    found = find_mounting(poses, SE3(matrices), GIVEN)
    assert np.linalg.norm(found.T_base_camera.translation - CAMERA.translation) < 0.05
    assert found.unobserved == ()
