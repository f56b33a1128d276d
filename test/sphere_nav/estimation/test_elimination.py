"""The reduced equations are those of all parameters at once; the covariance is that of the scatter of many drives."""

import numpy as np

from sphere_nav.estimation.elimination import Elimination, Part

SHARED, OWN = 2, 3
NO_PRIOR = np.full(SHARED, 1e6)


def parts_of(rng, truth, number, noise):
    parts = []
    for _ in range(number):
        J = rng.normal(size=(60, SHARED + OWN))
        common = noise * rng.normal() * rng.normal(size=60)  # residuals of one image err together
        residual = -J @ np.concatenate([truth, rng.normal(size=OWN)]) + common
        parts.append(Part(J.T @ J, J.T @ residual, 60, 1.0))
    return parts


def test_the_step_is_that_of_all_parameters_at_once(rng):
    parts = parts_of(rng, np.array([0.3, -0.2]), 4, 0.5)
    shared, own, _ = Elimination(parts, NO_PRIOR, np.zeros(SHARED)).step()
    n = SHARED + 4 * OWN
    H, g = np.zeros((n, n)), np.zeros(n)
    for k, part in enumerate(parts):
        index = [*range(SHARED), *range(SHARED + k * OWN, SHARED + (k + 1) * OWN)]
        H[np.ix_(index, index)] += part.H
        g[index] += part.g
    np.testing.assert_allclose(np.concatenate([shared, *own]), -np.linalg.solve(H, g), atol=1e-6)


def test_what_is_known_beforehand_counts_as_many_pixels(rng):
    known = np.array([0.1, 0.2])
    nothing = [Part(np.diag([0.0, 0.0, 1.0, 1.0, 1.0]), np.zeros(5), 0, 1.0)] * 3
    reduced = Elimination(nothing, known, np.array([0.05, 0.0]))
    np.testing.assert_allclose(reduced.step()[0], [-0.05, 0.0], atol=1e-12)  # back to where it was known to be
    np.testing.assert_allclose(reduced.covariance(), np.diag(known**2), atol=1e-12)
    alike = [Part(nothing[0].H, np.ones(5), 0, 1.0)] * 3  # what pulls all images the same way is no scatter
    np.testing.assert_allclose(Elimination(alike, known, np.zeros(SHARED)).covariance(), np.diag(known**2), atol=1e-12)
    H = np.diag([400.0, 25.0, 1.0, 1.0, 1.0])  # as much as is known beforehand: the step goes half of the way
    part = Part(H, -H @ [0.1, -0.2, 0.0, 0.0, 0.0], 60, 1.0)
    shared, _, _ = Elimination([part], np.array([0.5, 2.0]), np.zeros(SHARED)).step()
    np.testing.assert_allclose(shared, [0.05, -0.1])
    both = Elimination([part, part], np.array([0.5, 2.0]), np.zeros(SHARED)).covariance()  # alike: no scatter
    np.testing.assert_allclose(both, np.diag([0.25, 4.0]) / 9.0, rtol=1e-6)


def test_a_step_is_measured_by_what_a_hundred_pixels_for_one_leave(rng):
    H = np.diag([400.0, 25.0, 1.0, 1.0, 1.0])  # deviations 0.05 and 0.2 of independent pixels, 0.5 and 2.0 of these
    for step, size in (([-0.1, 0.1], 0.2), ([0.1, -0.8], 0.4)):
        part = Part(H, -H @ [*step, 0.0, 0.0, 0.0], 60, 1.0)
        shared, own, told = Elimination([part], NO_PRIOR, np.zeros(SHARED)).step()
        np.testing.assert_allclose(shared, step, rtol=1e-6)
        np.testing.assert_allclose(own, np.zeros((1, OWN)), atol=1e-12)
        np.testing.assert_allclose(told, size, rtol=1e-6)


def test_what_an_image_hardly_shows_of_its_own_steps_half_the_way_and_not_back():
    H = np.diag([1.0, 1.0, 1.0, 1.0, 1e-9])
    _, own, _ = Elimination([Part(H, -H.sum(axis=0), 60, 1.0)], NO_PRIOR, np.zeros(SHARED)).step()
    np.testing.assert_allclose(own, [[1.0, 1.0, 0.5]], rtol=1e-6)


def test_the_covariance_is_the_scatter_of_many_drives(rng):
    found, told = [], []
    for _ in range(200):
        parts = parts_of(rng, np.zeros(SHARED), 12, 1.0)
        shared, own, _ = Elimination(parts, NO_PRIOR, np.zeros(SHARED)).step()
        at_end = []
        for part, step in zip(parts, own, strict=True):  # the gradients where the fit ends
            at_end.append(Part(part.H, part.g + part.H @ np.concatenate([shared, step]), 60, 1.0))
        found.append(shared)
        told.append(np.diagonal(Elimination(at_end, NO_PRIOR, shared).covariance()))
    np.testing.assert_allclose(np.mean(told, axis=0) / np.var(found, axis=0), 1.0, atol=0.35)


def test_images_that_err_alike_count_once(rng):
    runs = parts_of(rng, np.zeros(SHARED), 5, 1.0)
    each = np.diagonal(Elimination(runs, NO_PRIOR, np.zeros(SHARED)).covariance())
    copies = Elimination([part for part in runs for _ in range(4)], NO_PRIOR, np.zeros(SHARED))
    np.testing.assert_allclose(np.diagonal(copies.covariance(num_blocks=5)), each, rtol=1e-6)
    assert np.all(np.diagonal(copies.covariance()) < 0.5 * each)
    for number in (1, 20, 27):  # no runs, or as many as parts
        np.testing.assert_array_equal(copies.covariance(num_blocks=number), copies.covariance())
