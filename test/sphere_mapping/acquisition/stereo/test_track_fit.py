"""What is off in a disparity is found from tracks without truth; a right pair is left alone."""

import numpy as np
import pytest

from sphere_mapping.acquisition.stereo.stereo_field import basis_of_columns
from sphere_mapping.acquisition.stereo.track_fit import Window, fit_columns
from sphere_nav.geometry import SE3, Pinhole

CAMERA = Pinhole(640, 400, 500.0, 500.0, 319.5, 199.5)
BASELINE = 0.4
NOISE_PX = 0.15


def window(rng, columns, num=150, num_wrong=0):
    """Return corners of a scene 3 to 30 m away while the camera drives 0.4 m an instant and turns a little."""
    at = rng.uniform((20, 20), (620, 380), (num, 2))
    depth = 1 / rng.uniform(1 / 30, 1 / 3, num)
    points = np.column_stack([(at - (CAMERA.cx, CAMERA.cy)) / CAMERA.fx, np.ones(num)]) * depth[:, None]
    left, right = [], []
    for k in range(4):
        T = SE3.exp(np.array([0.02, 0.0, -0.4, 0.002, 0.004, 0.001]) * k)
        p = T.apply(points)
        right_x = (p[:, 0] - BASELINE) / p[:, 2]
        left.append(p[:, :2] / p[:, 2:] * CAMERA.fx + (CAMERA.cx, CAMERA.cy))
        off = basis_of_columns(right_x, p[:, 1] / p[:, 2])[:, : len(columns)] @ columns
        right.append(right_x * CAMERA.fx + CAMERA.cx + off)
    left, right = np.stack(left), np.stack(right)
    left += rng.normal(0, NOISE_PX, left.shape)
    right += rng.normal(0, NOISE_PX, right.shape)
    left[1:, :num_wrong] += rng.normal(0, 20, (3, num_wrong, 2))
    return Window(left, right)


def test_offset_and_bow_are_recovered_within_their_deviations():
    rng, columns = np.random.default_rng(0), np.array([0.7, 2.5])
    fit = fit_columns(CAMERA, BASELINE, [window(rng, columns, num_wrong=20) for _ in range(8)])
    assert fit.is_significant
    off = fit.columns - columns
    assert off @ np.linalg.solve(fit.covariance, off) < 13.8
    assert np.abs(off).max() < 0.3


def test_a_right_pair_is_left_alone():
    rng = np.random.default_rng(100)
    fit = fit_columns(CAMERA, BASELINE, [window(rng, np.zeros(2)) for _ in range(4)])
    assert not fit.is_significant
    assert fit_columns(CAMERA, BASELINE, []) is None


@pytest.mark.slow
def test_corners_that_are_lost_count_until_then():
    rng, columns = np.random.default_rng(0), np.array([0.7, 2.5])

    def lose(whole):
        last = rng.integers(2, 5, whole.left.shape[1])  # instants in which each is seen
        is_lost = np.arange(4)[:, None] >= last
        left, right_u = (
            np.where(mask, np.nan, one) for mask, one in ((is_lost[..., None], whole.left), (is_lost, whole.right_u))
        )
        return Window(left, right_u)

    wholes = [window(rng, columns) for _ in range(8)]
    fits = {
        name: fit_columns(CAMERA, BASELINE, [make(one) for one in wholes])
        for name, make in (
            ("all", lambda one: one),
            ("lost", lose),
            ("to the end", lambda one: Window(one.left[:, ::3], one.right_u[:, ::3])),  # a third lives that long
        )
    }
    off = fits["lost"].columns - columns
    assert off @ np.linalg.solve(fits["lost"].covariance, off) < 13.8
    bow = {name: fit.covariance[1, 1] for name, fit in fits.items()}
    assert bow["all"] < bow["lost"] < bow["to the end"]
