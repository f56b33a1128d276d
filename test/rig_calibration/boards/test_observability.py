"""What the images leave open is said, and only that; what they determine scatters as the report promises."""

from types import SimpleNamespace

import numpy as np
import pytest

from rig_calibration.boards import observability
from rig_calibration.boards.board import Board
from rig_calibration.boards.bundle import SHARED, RigState
from rig_calibration.boards.views import BoardView
from rig_calibration.calibrate import CameraSpec, calibrate
from sphere_nav.geometry import SE3
from sphere_nav.geometry.cameras.lens import NUM_LENS
from sphere_nav.geometry.cameras.rig import Rig
from sphere_nav.spheres.sphere import T_BODY_OPTICAL
from worlds.boards import BoardWorld, boards_around, ring_rig, vertical_rig, wandering


def calibrated(rig, num_boards, num_instants, seed, *, is_drive_only=False):
    rng = np.random.default_rng(seed)
    boards, poses = boards_around(Board, num_boards, 1.3, rng)
    world = BoardWorld(rig, boards, poses, wandering(num_instants, rng, is_drive_only=is_drive_only))
    parts = rig.cameras
    specs = [CameraSpec(p.name, p.camera.model, (p.camera.width, p.camera.height), p.camera) for p in parts]
    return calibrate(specs, boards, world.views(BoardView, 0.1, rng), parts[0].T_rig_camera)


def two_sectors():
    whole = vertical_rig((480, 360)).cameras
    return Rig((whole[0], whole[2]), "two sectors")


@pytest.mark.slow
def test_a_rig_that_only_drives_leaves_the_height_open():
    found = calibrated(two_sectors(), 6, 12, 1, is_drive_only=True)
    assert any("top1: z (up) cannot be observed" in line for line in found.warnings)
    assert any("tilt the rig (roll and pitch)" in line for line in found.warnings)
    assert not np.isfinite(found.spread.pose_std[1, 2])
    assert not any("top0" in line and "observed" in line for line in found.warnings)


@pytest.mark.slow
def test_errors_scatter_as_the_report_promises():
    rig = Rig(ring_rig((480, 360)).cameras[:2], "pair")
    truth, values = rig.cameras[1].T_rig_camera, []
    for seed in range(3):
        found = calibrated(rig, 5, 14, [seed, 5])
        xi = (truth.inverse() @ found.rig.cameras[1].T_rig_camera).log()
        error = np.concatenate([truth.rotation @ xi[:3], truth.rotation @ xi[3:]])
        values.append(error @ np.linalg.solve(found.spread.poses[1], error))
    # the sum of three is chi-squared with 18 degrees of freedom: within 5.5 and 40 in 99.6 of 100 cases
    assert 5.5 < sum(values) < 40.0


def test_what_is_weak_is_told_in_the_axes_of_the_rig(monkeypatch):
    """A camera moves along and turns about the axes of the rig, whatever way it looks, and so it is told."""
    poses = SE3(T_BODY_OPTICAL.matrix[None])
    moved = RigState(np.zeros((1, NUM_LENS)), poses, poses, poses).moved(np.eye(30)[NUM_LENS])
    np.testing.assert_allclose(moved.T_rig_camera.translation, [[1.0, 0.0, 0.0]])
    variance = np.full(SHARED, 1e-6)
    variance[NUM_LENS + np.array([0, 3])] = 0.01, np.radians(20.0) ** 2
    monkeypatch.setattr(observability, "information", lambda *_: np.diag(1.0 / variance))
    problem = SimpleNamespace(seen=SimpleNamespace(instant=np.zeros(1, int), view=np.zeros(100, int)))
    found = observability.spread(problem, moved, np.ones((100, 2)), np.ones(100))
    np.testing.assert_allclose(found.pose_std[0, [1, 2]] / found.pose_std[0, 0], 0.01)
    np.testing.assert_allclose(found.pose_std[0, [4, 5]] / found.pose_std[0, 3], 1e-3 / np.radians(20.0))
    x, roll, _ = observability.warnings(("front",), found)
    assert ("x (forward)" in x, "roll (about x)" in roll) == (True, True)


def test_a_rotation_known_to_more_than_a_tenth_of_a_degree_or_a_place_to_five_millimetres_is_worth_a_warning():
    limits = np.repeat([0.005, np.radians(0.1)], 3)
    for factor, told in [(0.9, []), (1.1, ["is weakly observed"] * 6), (11.0, ["cannot be observed"] * 6)]:
        found = observability.Spread(0.2, np.zeros((1, 12, 12)), np.diag((factor * limits) ** 2)[None])
        lines = observability.warnings(("front",), found)
        assert [words in line for words, line in zip(told, lines[:6], strict=True)] == [True] * len(told)
    assert lines[2] == "front: z (up) cannot be observed (standard deviation 55.0 mm)"
    assert lines[6].startswith("tilt the rig")
