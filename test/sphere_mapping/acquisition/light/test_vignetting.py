"""Falloff and exposures are those that levels were made with."""

import numpy as np
import pytest

from sphere_mapping.acquisition.light.light import Falloff, PairRatios, falloff

TRUE = np.array([-0.3, -0.1, -0.4])


def comparison(rng, exposures=(0.0, 0.25), lenses=(TRUE, TRUE), number=600, wrong=0.0, noise=0.02):
    """Pairs of angles all over two lenses; a share of the ratios is of two different things."""
    squares = rng.random((2, number))
    numbers = np.zeros(number, np.intp), np.ones(number, np.intp)
    ratio = exposures[0] - exposures[1] + falloff(lenses[0], squares[0]) - falloff(lenses[1], squares[1])
    ratio = ratio + rng.normal(0, noise, number)
    is_wrong = rng.random(number) < wrong
    ratio[is_wrong] += rng.exponential(1.0, np.count_nonzero(is_wrong))
    return PairRatios(numbers, numbers, (squares[0], squares[1]), ratio, np.full(number, 0.05))


@pytest.mark.parametrize("wrong", [0.3])
def test_falloff_and_exposures_are_found(rng, wrong):
    found = Falloff(["lens", "lens"])
    seen = [comparison(rng, wrong=wrong) for _ in range(8)]
    for one in seen:
        found.update(one, 2)
    at = np.linspace(0, 1, 9)
    for coefficients in found.coefficients:
        np.testing.assert_allclose(falloff(coefficients, at), falloff(TRUE, at), atol=0.02 if wrong == 0 else 0.05)
    np.testing.assert_allclose(np.diff(found.exposures(seen[0], 2)), 0.25, atol=0.01 if wrong == 0 else 0.05)


def test_no_lens_is_said_to_brighten_towards_its_rim(rng):
    found = Falloff(["lens", "lens"])
    found.update(comparison(rng, lenses=(-TRUE, -TRUE)), 2)
    assert found.coefficients.max() <= 0.0
