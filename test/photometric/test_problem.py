"""The stacked normal equations against numerical derivatives of the residuals."""

import cv2
import numpy as np

from photometric import RegistrationParams, View, build_pyramid, prepare_reference
from photometric.problem import Problem, State
from sphere_geometry import SE3, Pinhole, Spherical

CAMERA = Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5)
SPHERE = Spherical(1024, 512)
T_BODY_OPTICAL = SE3.from_parts([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], [0, 0, 0])
A, B = SE3.from_planar(0.5, -0.4, 0.3), SE3.from_planar(0.9, -0.3, 0.5)


def make_problem(room, params):
    views = []
    for T_room_sphere in (A, B):
        image, range_m = room.render(SPHERE, T_room_sphere)
        views.append(View(prepare_reference(image, range_m, SPHERE, params), T_room_sphere))
    truth = A @ SE3.exp([0.1, 0.05, 0.02, 0.0, 0.01, 0.05]) @ T_BODY_OPTICAL
    image, _ = room.render(CAMERA, truth)
    level = build_pyramid(image, CAMERA, params.pyramid).levels[1]  # smooth enough for differences
    return Problem.choose_pixels(level, views, truth, params), State.start(truth, 2)


def residuals(problem, state):
    return np.concatenate([view.residual.copy() for view in problem.compare(state)]).astype(np.float64)


def test_the_normal_matrix_is_that_of_numerical_derivatives_in_the_camera_tangent(room):
    params = RegistrationParams(huber=1000.0)  # no pixel weighs less: the cost is a plain sum of squares
    smooth, range_m = room.render(CAMERA, A @ T_BODY_OPTICAL)
    smooth = cv2.GaussianBlur(smooth, (0, 0), 3.0)  # so that central differences are the derivative
    T_world_reference = A @ T_BODY_OPTICAL
    view = View(prepare_reference(smooth, range_m, CAMERA, params), T_world_reference)
    level = build_pyramid(smooth, CAMERA, params.pyramid).levels[0]
    problem = Problem.choose_pixels(level, [view], T_world_reference, params)
    state = State.start(T_world_reference @ SE3.exp([1e-4, 0, 0, 0, 1e-4, 0]), 1)  # off the pixel centres
    H, g = problem.joint(problem.compare(state))
    columns, step = [], 5e-4
    for axis in np.eye(6):
        sides = [State(state.T_world_camera @ SE3.exp(s * step * axis), (1.0,), (0.0,)) for s in (1, -1)]
        columns.append((residuals(problem, sides[0]) - residuals(problem, sides[1])) / (2 * step))
    J, e = np.stack(columns, axis=1), residuals(problem, state)
    seen = ~np.isnan(J).any(axis=1)
    numerical = J[seen].T @ J[seen]
    scale = np.sqrt(np.diag(numerical))
    (view,) = problem.compare(state)
    H, g = H * view.sigma**2, g * view.sigma**2
    assert np.abs((H[:6, :6] - numerical) / np.outer(scale, scale)).max() < 0.02
    assert np.abs((g[:6] - J[seen].T @ e[seen]) / scale).max() < 0.02 * np.linalg.norm(e[seen])


def test_a_step_reduces_the_residuals_of_both_views(room):
    params = RegistrationParams()
    problem, state = make_problem(room, params)
    off = State(state.T_world_camera @ SE3.exp([0.01, -0.01, 0.005, 0.002, 0.001, -0.002]), state.gains, state.biases)
    before = [view.mad for view in problem.compare(off)]
    after = [view.mad for view in problem.compare(off.moved(problem.step(off)))]
    assert all(b < 0.7 * a for a, b in zip(before, after, strict=True))


def test_rotation_only_leaves_the_place(room):
    problem, state = make_problem(room, RegistrationParams())
    assert np.array_equal(problem.step(state, rotation_only=True).xi[:3], np.zeros(3))
