"""The motion on which most cells agree: found among others, as sure as it is told, by chance as rare as told."""

import numpy as np
import pytest

from sphere_nav.photometric.constants import NUM_TRIED_MOTIONS
from sphere_nav.photometric.parts.motion import agreeing, fit_motion, motion_covariance
from sphere_nav.photometric.parts.votes import Shifts, chance_of

XI = np.array([0.05, -0.1, 0.2, 0.004, 0.01, -0.02])
REACH = 8


def cells(rng, number, share):
    """Cells of a camera of 165 px: the first ones show the map, the others anything."""
    rays = np.stack([rng.uniform(-0.7, 0.7, number), rng.uniform(-0.5, 0.5, number), np.ones(number)], axis=-1)
    z = rng.uniform(2.0, 8.0, number)
    x, y = rays[:, 0], rays[:, 1]
    zero = np.zeros(number)
    by_u = np.stack([-1 / z, zero, x / z, x * y, -(1 + x**2), y], axis=-1)
    by_v = np.stack([zero, -1 / z, y / z, 1 + y**2, -x * y, -x], axis=-1)
    by_pose = 165.0 * np.stack([by_u, by_v], axis=1)
    shift = rng.integers(-REACH, REACH + 1, (number, 2)).astype(float)
    whole = round(share * number)
    shift[:whole] = by_pose[:whole] @ XI + rng.uniform(-0.5, 0.5, (whole, 2))
    return Shifts(shift, by_pose)


def test_a_third_that_agrees_is_found():
    found = cells(np.random.default_rng(0), 90, 0.33)
    xi = fit_motion(found)
    assert agreeing(found, xi[None])[0][:30].mean() > 0.9
    np.testing.assert_allclose(found.by_pose @ xi, found.by_pose @ XI, atol=1.0)  # px


def test_three_cells_say_nothing():
    for number in [0, 1, 3]:
        found = cells(np.random.default_rng(1), number, 1.0)
        assert fit_motion(found) is None
        assert np.isinf(np.diagonal(motion_covariance(found))).all()


def test_the_covariance_is_that_of_the_motion():
    rng, nees = np.random.default_rng(7), []
    for _ in range(200):
        found = cells(rng, 60, 1.0)
        xi = fit_motion(found)
        there = Shifts(found.shift - found.by_pose @ xi, found.by_pose)
        error = xi - XI
        nees.append(error @ np.linalg.solve(motion_covariance(there), error) / 6)
    assert 0.7 < np.mean(nees) < 1.1  # a shift errs by 0.29 px here, by 0.3 px at least is assumed


@pytest.mark.slow
def test_the_chance_of_the_best_of_all_motions_is_not_larger_than_told():
    rng, chances = np.random.default_rng(11), []
    for _ in range(400):
        found = cells(rng, 60, 0.0)
        xi = fit_motion(found)
        agree = 0 if xi is None else int(agreeing(found, xi[None]).sum())
        chances.append(min(chance_of(60, agree) * NUM_TRIED_MOTIONS, 1.0))
    assert np.mean(np.array(chances) <= 0.05) <= 0.05
