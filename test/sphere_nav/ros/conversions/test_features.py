from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from sphere_nav.ros.conversions.clouds import features_to_message, message_to_features
from sphere_nav.spheres.appearance.features import Features


def sample(rng, number=7, **changed):
    rays = rng.normal(size=(number, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    range_m = np.where(np.arange(number) % 3 == 0, np.nan, rng.uniform(1, 9, number))
    descriptors = rng.integers(0, 256, (number, 128), dtype=np.uint8)
    values = {
        "rays": rays.astype(np.float32),
        "range_m": range_m.astype(np.float32),
        "descriptors": descriptors,
    } | changed
    return Features(**values), np.arange(number)


def test_what_does_not_fit_is_refused(rng):
    for field, value, reason in [
        ("width", 8, "expected 1168 bytes"),
        ("fields", [], "expected \\['x'"),
        ("data", b"", "found 0"),
    ]:
        message = features_to_message(*sample(rng), 5, "sphere_link")
        setattr(message, field, value)
        with pytest.raises(ValueError, match=reason):
            message_to_features(message)


def test_what_is_no_feature_is_refused(rng):
    for changed, reason in [
        ({"rays": np.full((7, 3), np.nan, np.float32)}, "unit vectors"),
        ({"range_m": np.full(7, -1.0, np.float32)}, "positive metres"),
    ]:
        with pytest.raises(ValueError, match=reason):
            message_to_features(features_to_message(*sample(rng, **changed), 5, "sphere_link"))


def test_a_ray_is_as_long_as_a_unit_vector_to_a_thousandth(rng):
    for length, is_taken in [(0.9995, True), (1.0005, True), (0.998, False), (1.002, False)]:
        features, words = sample(rng)
        message = features_to_message(replace(features, rays=length * features.rays), words, 5, "sphere_link")
        with nullcontext() if is_taken else pytest.raises(ValueError, match="unit vectors"):
            message_to_features(message)
