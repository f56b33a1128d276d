import numpy as np

from sphere_nav.photometric.checks.bias import linearize_samples, solve_robustly
from sphere_nav.photometric.pixels.samples import Sample

STEP = np.array([0.01, -0.02, 0.03, 0.004, -0.005, 0.006])


def sample_of(rng, num_views=1, number=400):
    """Pixels whose residuals are those of a step of the pose, of a gain and a bias."""
    view, number = np.repeat(np.arange(num_views), number), num_views * number
    points, gradients = rng.normal([0.0, 0.0, 4.0], 1.0, (number, 3)), rng.normal(0.0, 50.0, (number, 3))
    current, at = rng.uniform(50.0, 200.0, number), rng.uniform(-1.0, 1.0, (number, 2))
    by_point, zeros = np.zeros((number, 2, 3)), np.zeros(number)
    sample = Sample(view, points, zeros, by_point, gradients, gradients, zeros, current, zeros, at)
    light = 0.1 * current - 3.0
    return Sample(**{**vars(sample), "residual": -sample.by_pose @ STEP - light})


def test_the_step_of_the_pose_is_told_from_light_and_outliers():
    rng = np.random.default_rng(1)
    sample = sample_of(rng, 2)
    sample.residual[:40] += 100.0
    x, left, weight = solve_robustly(*linearize_samples(sample))
    assert x.shape == (6 + 2 * 2,)
    np.testing.assert_allclose(x[:6], STEP, atol=2e-3)
    np.testing.assert_allclose(x[6::2], 0.1, atol=2e-3)
    np.testing.assert_allclose(x[7::2], -3.0, atol=0.3)
    assert np.median(np.abs(left)) < 0.1
    assert np.max(weight[:40]) < 0.1 * np.median(weight)
