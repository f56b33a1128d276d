"""Factors of images, and how they follow from ratios."""

import numpy as np

from sphere_mapping.acquisition.light.exposure import apply_gain, log_gains


def test_a_gain_multiplies_and_white_stays_white():
    image = np.arange(256, dtype=np.uint8).reshape(16, 16)
    darker = apply_gain(image, np.array([0.5])).astype(int)
    np.testing.assert_array_equal(darker.flat[:236], np.rint(0.5 * np.arange(236)).astype(int))
    assert darker.flat[255] == 255
    assert np.all(np.diff(darker.ravel()) >= 0)
    assert apply_gain(image, np.array([3.0])).flat[100] == 255


def test_gains_of_a_chain_of_images_agree():
    levels = np.log([100.0, 150.0, 60.0])
    ratios = [(0, 1, np.array([levels[0] - levels[1]])), (1, 2, np.array([levels[1] - levels[2]]))]
    gains = log_gains(ratios, 3, 1)[:, 0]
    np.testing.assert_allclose(levels + gains, levels.mean(), atol=1e-3)
