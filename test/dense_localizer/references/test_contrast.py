"""Images of equal local contrast: what light does to an image is taken away, what the place does to it is not."""

import numpy as np
import pytest

from dense_localizer.constants import CONTRAST_SCALE
from dense_localizer.references.contrast import equalize_contrast, equalize_pyramid
from sphere_nav.geometry import Spherical
from sphere_nav.photometric import build_pyramid
from worlds.localizer import PINHOLE, at

WHOLE = Spherical(256, 128)


def correlation(a, b):
    return float(np.corrcoef(a.ravel(), b.ravel())[0, 1])


def test_another_light_changes_little(room):
    here = room.photograph(PINHOLE, at(0.2, 0.1, 0.1), 3).astype(np.float32)
    ramp = np.linspace(0.2, 1.0, PINHOLE.width, dtype=np.float32)  # half of the view is in shade
    elsewhere = room.photograph(PINHOLE, at(-1.2, 0.2, 2.0), 3).astype(np.float32)
    equal, dimmed, other = (equalize_contrast(one, PINHOLE) for one in (here, here * ramp + 20.0, elsewhere))
    assert correlation(equal, dimmed) > 0.9 > correlation(here, here * ramp + 20.0)
    assert abs(correlation(equal, other)) < 0.3


def test_contrast_is_that_of_its_surroundings():
    rng = np.random.default_rng(1)
    image = 100.0 + rng.normal(0.0, 1.0, (120, 160)) * np.linspace(10.0, 40.0, 160)
    equal = equalize_contrast(image, PINHOLE)
    assert equal.dtype == np.float32
    np.testing.assert_allclose([equal[:, :50].std(), equal[:, 110:].std()], CONTRAST_SCALE, rtol=0.15)
    np.testing.assert_allclose(equal.mean(), 128.0, atol=2.0)
    flat = equalize_contrast(np.full((120, 160), 90.0) + rng.normal(0.0, 0.5, (120, 160)), PINHOLE)
    assert flat.std() < 0.2 * CONTRAST_SCALE  # noise of an empty view is not made a picture


def test_a_whole_sphere_closes():
    image = np.random.default_rng(2).uniform(0.0, 255.0, (128, 256)).astype(np.float32)
    turned = equalize_contrast(np.roll(image, 100, axis=1), WHOLE)
    np.testing.assert_allclose(turned, np.roll(equalize_contrast(image, WHOLE), 100, axis=1), atol=0.05)


@pytest.mark.parametrize("num_levels", [1, 2, 4])
def test_the_coarsest_levels_are_kept(num_levels):
    image = np.random.default_rng(3).uniform(0.0, 255.0, (120, 160)).astype(np.uint8)
    pyramid = build_pyramid(image, PINHOLE)
    pyramid = type(pyramid)(pyramid.levels[:num_levels])
    assert equalize_pyramid(pyramid).cameras == pyramid.cameras[-2:]
