"""The encoders: against their twin, no seam, the weights of the package. One answer by particles and by the survey."""

from __future__ import annotations

import numpy as np
import pytest

from mcl_depth.constants import CHANCE, NUM_FREQUENCIES
from mcl_depth.geometry.synthesis import panorama_window
from mcl_depth.likeness.learned import Encoder, Learned, depth_inputs, image_inputs, load_encoders, normalize
from mcl_depth.params import SynthesisParams

WINDOW = panorama_window(SynthesisParams())
EVERYWHERE = np.ones((WINDOW.height, WINDOW.width), np.bool_)
LAYERS = ((4, 5, 5, 2, 2), (6, 3, 3, 1, 1), (3, 1, 1, 2, 1))


def chain(num_inputs, rng):
    """An encoder of random weights with every kind of layer: strides, and filters of one, three and five columns."""
    table, values = [], []
    for outputs, h, w, stride_y, stride_x in LAYERS:
        table.append((num_inputs, outputs, h, w, stride_y, stride_x))
        values += [rng.normal(size=outputs * num_inputs * h * w), rng.normal(size=outputs)]
        num_inputs = outputs
    return Encoder(np.array(table, np.int64), np.concatenate(values).astype(np.float32))


def twin(encoder, inputs):
    """The same in float64, by sums over windows of a picture that was made wider."""
    image, first = inputs.astype(np.float64), 0
    for number, (n, o, h, w, stride_y, stride_x) in enumerate(encoder.table):
        count = n * o * h * w
        weights = encoder.values[first : first + count].reshape(o, n, h, w).astype(np.float64)
        biases = encoder.values[first + count : first + count + o].astype(np.float64)
        first += count + o
        wide = np.pad(np.pad(image, ((0, 0), (h // 2, h // 2), (0, 0))), ((0, 0), (0, 0), (w // 2, w // 2)), "wrap")
        windows = np.lib.stride_tricks.sliding_window_view(wide, (h, w), axis=(1, 2))[:, ::stride_y, ::stride_x]
        image = np.einsum("cyxhw,ochw->oyx", windows, weights) + biases[:, None, None]
        image = np.maximum(image, 0.0) if number < len(encoder.table) - 1 else image
    return image


@pytest.mark.slow
def test_the_kernel_does_what_its_twin_does():
    rng = np.random.default_rng(1)
    encoder, inputs = chain(3, rng), rng.normal(size=(2, 3, 11, 24)).astype(np.float32)
    found = encoder(inputs)
    wanted = np.stack([twin(encoder, item) for item in inputs])
    assert found.shape == wanted.shape == (2, 3, 3, 12)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-5 * np.abs(wanted).max())  # float32 sums


def test_a_turned_panorama_has_turned_features():
    rng = np.random.default_rng(2)
    gray = rng.uniform(0, 255, (WINDOW.height, WINDOW.width)).astype(np.float32)
    range_m = rng.uniform(1, 20, gray.shape).astype(np.float32)
    range_m[rng.random(gray.shape) < 0.1] = np.nan
    likeness = Learned(WINDOW)
    step = int(np.prod(load_encoders().image.table[:, 5]))
    for columns in (step, 17 * step):
        image = likeness.image(np.roll(gray, columns, axis=1), EVERYWHERE)
        depth = likeness.depth_features(np.roll(range_m, columns, axis=1)[None])[0]
        straight = likeness.image(gray, EVERYWHERE), likeness.depth_features(range_m[None])[0]
        for found, wanted in zip((image, depth), straight, strict=True):
            np.testing.assert_allclose(found, np.roll(wanted, columns // step, axis=-1), rtol=0, atol=1e-5)


def test_features_have_length_one_no_mean_and_nothing_finer_than_the_filter_keeps():
    features = normalize(np.random.default_rng(3).normal(3.0, 2.0, (2, 4, 5, 90)).astype(np.float32))
    np.testing.assert_allclose(np.sum(features**2, axis=(1, 2, 3)), 1.0, rtol=1e-5)
    spectra = np.abs(np.fft.rfft(features, axis=-1))
    assert max(spectra[..., 0].max(), spectra[..., NUM_FREQUENCIES:].max()) < 1e-5


def test_brightness_and_contrast_of_an_image_do_not_count_and_what_is_not_seen_has_none():
    gray = np.random.default_rng(5).uniform(60, 120, (WINDOW.height, WINDOW.width)).astype(np.float32)
    np.testing.assert_allclose(
        image_inputs(2.0 * gray + 7.0, EVERYWHERE, WINDOW), image_inputs(gray, EVERYWHERE, WINDOW), atol=2e-3
    )
    is_seen = np.ones(gray.shape, np.bool_)
    is_seen[:4] = False
    inputs = image_inputs(np.where(is_seen, gray, 250.0).astype(np.float32), is_seen, WINDOW)
    np.testing.assert_array_equal(inputs[:-1, :4], 0.0)
    np.testing.assert_array_equal(inputs, image_inputs(np.where(is_seen, gray, 0.0), is_seen, WINDOW))


def test_an_unknown_range_is_told_from_a_far_one():
    ranges = np.full((1, WINDOW.height, WINDOW.width), 2.0, np.float32)
    ranges[0, 0, 0], ranges[0, 0, 1] = np.nan, np.inf
    inputs = depth_inputs(ranges, WINDOW)[0]
    np.testing.assert_allclose(inputs[:3, 0, 0], [0.0, 0.0, 0.0])
    np.testing.assert_allclose(inputs[:3, 0, 1], [np.log(200.0) - 1.0, 1.0 / 200.0, 1.0], rtol=1e-5)
    np.testing.assert_allclose(inputs[:3, 1, 1], [np.log(2.0) - 1.0, 0.5, 1.0], rtol=1e-5)


NUM_CELLS, NUM_HEADINGS = 60, 36


@pytest.fixture(scope="module")
def ranges():
    """Cells before walls with pillars of their own."""
    rng = np.random.default_rng(6)
    ranges = np.full((NUM_CELLS, WINDOW.height, WINDOW.width), 5.0, np.float32)
    for panorama in ranges:
        for _ in range(6):
            u, v, width = rng.integers(WINDOW.width), rng.integers(WINDOW.height - 12), rng.integers(4, 20)
            panorama[v : v + 12, (u + np.arange(width)) % WINDOW.width] = rng.uniform(1.0, 3.0)
    return ranges


def test_place_and_heading_are_found_by_the_circular_correlation_of_the_features(ranges):
    likeness, slots = Learned(WINDOW), np.arange(NUM_CELLS)
    features, stack = likeness.depth_features(ranges), likeness.depths(ranges)
    width = features.shape[-1]
    for cell, columns in ((7, 0), (33, 25), (59, 80)):
        seen = np.roll(features[cell], columns, axis=-1)
        found = likeness.survey(seen, stack, slots, NUM_HEADINGS)
        assert np.unravel_index(np.argmax(found), found.shape) == (cell, columns * 4 // 10)
        np.testing.assert_array_equal(likeness.survey(seen, stack, np.array([3, -1]), NUM_HEADINGS)[0], found[3])
        np.testing.assert_array_equal(likeness.survey(seen, stack, np.array([3, -1]), NUM_HEADINGS)[1], 0.0)
        np.testing.assert_allclose(likeness.compare(seen, stack, slots, NUM_HEADINGS) - CHANCE, found, atol=1e-6)
    shifted = np.stack([np.roll(features[5], shift, axis=-1) for shift in range(width)])
    wanted = np.einsum("scyx,ncyx->ns", shifted, features)
    found = likeness.survey(features[5], stack, slots, NUM_HEADINGS)
    for heading in (0, 4, 12, 18):  # a whole number of columns
        at = -heading * width // NUM_HEADINGS  # an image that is turned back so far
        assert np.all(found[:, heading] > wanted[:, at] - 0.01)  # what bytes lose; the best around a heading
    assert found[5, 0] == pytest.approx(1.0, abs=0.01)
    assert np.corrcoef(found[:, 12], wanted[:, -30])[0, 1] > 0.8 > np.corrcoef(found[:, 12], wanted[:, 30])[0, 1]
