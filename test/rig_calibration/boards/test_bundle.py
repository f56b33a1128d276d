"""One camera: its lens comes back, false corners go, a disturbed solution settles where it was."""

import numpy as np
import pytest

from rig_calibration.boards.board import Board
from rig_calibration.boards.bundle import (
    camera_state,
    information,
    normal_equations,
    residuals,
    rig_problem,
    rms_px,
    solve,
)
from rig_calibration.boards.intrinsics import calibrate_camera, view_poses
from rig_calibration.boards.validation import camera_rms
from rig_calibration.boards.views import observations
from sphere_nav.geometry import SE3, Omni, Pinhole
from sphere_nav.geometry.cameras.lens import lens_of

CAMERA = Pinhole(640, 480, 400.0, 402.0, 318.0, 243.0, (-0.2, 0.05, 1e-3, -5e-4, -0.01))
BOARD = Board("b", 9, 6, 0.1)


@pytest.fixture(scope="module")
def seen():
    return views_of(CAMERA)


def views_of(camera, spread=0.3, nearest=0.9):
    """Return 15 views; the spread of their centres by distance."""
    rng = np.random.default_rng(1)
    pixels = []
    while len(pixels) < 15:
        R = SE3.exp([0, 0, 0, *rng.normal(0.0, 0.4, 3)]).rotation
        center = np.array([*rng.normal(0.0, spread, 2), 1.0]) * rng.uniform(nearest, nearest + 0.7)
        found, is_seen = camera.project(SE3.from_parts(R, center - R @ BOARD.points.mean(axis=0)).apply(BOARD.points))
        if is_seen.all():
            pixels.append(found + rng.normal(0.0, 0.1, found.shape))
    return observations([0] * 15, range(15), [0] * 15, [BOARD.points] * 15, pixels)


@pytest.fixture(scope="module")
def single(seen):
    return calibrate_camera("pinhole", (640, 480), seen)


OMNI = Omni(640, 480, 430.0, 431.0, 318.0, 243.0, 1.2, (-0.1, 0.04, 1e-3, -5e-4))


@pytest.mark.slow
def test_a_wide_lens_comes_back_in_its_own_model():
    camera = OMNI
    views = views_of(camera, 1.0, 0.3)
    found = calibrate_camera(camera.model, (640, 480), views)
    assert type(found.camera) is type(camera)
    rays = camera.unproject(views.pixels)
    assert np.degrees(np.arccos(rays[:, 2].min())) > 75.0
    angle = np.linalg.norm(np.cross(found.camera.unproject(views.pixels), rays), axis=1)
    assert np.degrees(angle.max()) < 0.1  # a tenth of a pixel is 0.03 degrees
    assert rms_px(found.adjusted.residuals, found.adjusted.kept) < 0.15


def test_a_disturbed_solution_settles_where_it_was(seen, single):
    problem = rig_problem(("pinhole",), ((640, 480),), seen)
    best, kept = single.adjusted, single.adjusted.kept
    disturbed = best.state.moved(np.append(np.zeros(24), np.full(90, 0.01)))
    _, again = solve(problem, disturbed, kept)
    assert rms_px(again, kept) == pytest.approx(rms_px(best.residuals, kept), rel=1e-6)
    assert camera_rms(problem, again, np.ones(810))[0] < 0.15  # sqrt(2) times the noise, at most


def test_what_views_tell_of_a_lens_is_what_is_left_when_their_poses_are_free(seen):
    problem = rig_problem(("pinhole",), ((640, 480),), seen)
    T_camera_board = view_poses(CAMERA, seen)
    state, weights = camera_state(lens_of(CAMERA), T_camera_board), np.ones(len(seen.pixels))
    weights[seen.rows[0]] = 0.0  # a view that was left out says nothing
    H, _ = normal_equations(problem, state, residuals(problem, state), weights)
    covariance = np.linalg.pinv(H)[:4, :4]  # of the focal lengths and the centre
    found = np.linalg.pinv(information(problem, state, weights))[:4, :4]
    np.testing.assert_allclose(found, covariance, rtol=1e-4)


def test_points_behind_the_camera_are_refused(seen):
    state = camera_state(
        np.array([400.0, 400, 320, 240, *np.zeros(8)]), SE3.exp(np.tile([0, 0, -3.0, 0, 0, 0], (15, 1)))
    )
    with pytest.raises(ValueError, match="in front of"):
        solve(rig_problem(("pinhole",), ((640, 480),), seen), state, np.ones(810))
