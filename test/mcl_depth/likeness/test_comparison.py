"""Features and eq. 2 against a slow, literal transcription of the paper."""

from __future__ import annotations

import numpy as np
import pytest

from mcl_depth.belief.particles import best_headings
from mcl_depth.likeness.features import visual_features
from mcl_depth.likeness.gradients import Gradients
from mcl_depth.params import ComparisonParams
from worlds.panoramas import depth_features

H, W = 12, 36
PARAMS = ComparisonParams()
RADIUS = 2  # 20 degrees


def literal_sobel(D: np.ndarray) -> np.ndarray:
    """Gradients (H, W, 2)."""
    padded = np.pad(np.pad(D, ((1, 1), (0, 0)), "edge"), ((0, 0), (1, 1)), "wrap")
    kernel = np.array([[-1.0, 0, 1], [-2, 0, 2], [-1, 0, 1]])
    windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3))
    return np.stack([np.sum(windows * kernel, axis=(2, 3)), np.sum(windows * kernel.T, axis=(2, 3))], axis=-1)


def literal_similarity(Gv: np.ndarray, Gd: np.ndarray) -> float:
    """Eq. 2 as it stands."""
    dot = np.sum(Gv * Gd, axis=-1, keepdims=True)
    on_depth = np.linalg.norm(dot / np.sum(Gd**2, axis=-1, keepdims=True) * Gd, axis=-1)
    on_visual = np.linalg.norm(dot / np.sum(Gv**2, axis=-1, keepdims=True) * Gv, axis=-1)
    return float(on_depth.sum() + on_visual.sum())


def normalized(G: np.ndarray) -> np.ndarray:
    return G / np.linalg.norm(G, axis=-1).sum()


def similarity(visual, range_m, num_headings):
    """Eq. 2 (num_headings,) with one panorama of two."""
    likeness = Gradients(PARAMS)
    return likeness.compare(
        visual, likeness.depths(np.stack([np.ones_like(range_m), range_m])), np.array([1]), num_headings
    )[0]


@pytest.fixture
def images(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    return (255 * rng.random((H, W))).astype(np.float32), (1 + 9 * rng.random((H, W))).astype(np.float32)


def test_similarity_is_equation_2_for_every_rotation(images) -> None:
    gray, range_m = images
    found = similarity(visual_features(gray), range_m, 12)
    Gv, Gd = normalized(literal_sobel(gray.astype(float))), literal_sobel(local_contrast(range_m, RADIUS))
    Gd = normalized(Gd)
    expected = [literal_similarity(Gv, np.roll(Gd, i * W // 12, axis=1)) for i in range(12)]
    np.testing.assert_allclose(found, expected, rtol=5e-3)  # half a step of 0.7 degrees and 1 % of magnitude, averaged


def test_a_turned_camera_has_the_heading_of_the_turn(images) -> None:
    _, range_m = images
    gray = np.roll(range_m, 9, axis=1)  # the camera turned to the left sees everything farther right
    found = best_headings(similarity(visual_features(gray), range_m, W)[None])[0]
    assert abs(found - np.pi / 2) < np.radians(10)  # one step


def test_no_seam_shows(images) -> None:
    gray, range_m = images
    range_m[3:6, [0, 1, W - 1]] = np.nan
    for make in (lambda image: visual_features(image), lambda image: depth_features(image, PARAMS)):
        image = gray if make(gray) is None else range_m
        image = np.where(np.isfinite(image), image, np.nan).astype(np.float32)
        rolled, plain = make(np.roll(image, 5, axis=1)), make(image)
        np.testing.assert_allclose(rolled.magnitude, np.roll(plain.magnitude, 5, axis=1), atol=1e-5)


def test_unseen_pixels_count_nothing(images) -> None:
    gray, range_m = images
    is_seen = np.zeros((H, W), bool)
    is_seen[:, 8:30] = True
    other = np.where(is_seen, gray, 255 - gray).astype(np.float32)
    one, two = (similarity(visual_features(image, is_seen), range_m, 12) for image in (gray, other))
    np.testing.assert_array_equal(one, two)


def test_contrast_is_local_to_twenty_degrees_and_outdoors_to_ten(rng) -> None:
    """Of a panorama of 72 columns: 4 and 2 columns either side."""
    range_m = (1 + 9 * rng.random((20, 72))).astype(np.float32)
    for is_sky_far, k in ((False, 4), (True, 2)):
        expected = normalized(literal_sobel(local_contrast(range_m, k)))
        found = depth_features(range_m, ComparisonParams(is_sky_far=is_sky_far))
        np.testing.assert_allclose(found.magnitude, np.linalg.norm(expected, axis=-1), rtol=2e-3, atol=1e-7)
        np.testing.assert_allclose(found.x * found.magnitude, expected[..., 0], rtol=2e-3, atol=2e-7)


def local_contrast(range_m, k):
    """Eq. 1, pixel by pixel; columns wrap, rows end."""
    height, width = range_m.shape
    windows = [
        range_m[max(y - k, 0) : y + k + 1][:, np.arange(x - k, x + k + 1) % width].astype(float)
        for y in range(height)
        for x in range(width)
    ]
    means, sigmas = (np.array([f(w) for w in windows]).reshape(range_m.shape) for f in (np.mean, np.std))
    return (range_m - means) / sigmas


def around(mask: np.ndarray, combine) -> np.ndarray:
    """What `combine` says of the 3 x 3 around every pixel of (H, W); columns wrap, the outer rows repeat."""
    padded = np.pad(np.pad(mask, ((1, 1), (0, 0)), "edge"), ((0, 0), (1, 1)), "wrap")
    return combine(np.lib.stride_tricks.sliding_window_view(padded, (3, 3)), axis=(2, 3))


def test_edges_only_where_measured_rest_on_ranges(rng) -> None:
    """A gap of up to two pixels between ranges is an edge; the rim of what is unknown is none, nor at the seam."""
    range_m = rng.uniform(5.0, 9.0, (H, W)).astype(np.float32)
    range_m[:, :4] = range_m[:, -5:] = np.nan  # across the seam
    range_m[:5, 20:] = np.nan  # above
    range_m[8, 12] = np.nan  # alone
    measured = around(around(np.isfinite(range_m), np.any), np.all)
    assert measured[8, 12]
    assert not measured[:, 3].any()
    assert not measured[:, -5].any()
    assert 0.2 < measured.mean() < 0.8
    everywhere = depth_features(range_m, PARAMS)
    found = depth_features(range_m, ComparisonParams(is_measured_only=True))
    assert np.array_equal(found.magnitude > 0.0, measured & (everywhere.magnitude > 0.0))
    assert np.allclose(found.magnitude.sum(), 1.0, atol=1e-5)
    expected = np.where(measured, everywhere.magnitude, 0.0)
    assert np.allclose(found.magnitude, expected / expected.sum(), rtol=1e-4)
    assert np.array_equal(found.x[measured], everywhere.x[measured])
    coded = Gradients(ComparisonParams(is_measured_only=True)).depths(range_m[None])
    assert not coded["magnitudes"][0][~measured].any()
