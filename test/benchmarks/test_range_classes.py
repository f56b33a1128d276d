"""What range is judged by."""

import numpy as np

from benchmarks.mapping.range_classes import CLASSES, classify
from sphere_nav.geometry import SE3, Spherical


def test_a_post_is_thin_and_what_is_beside_a_jump_an_edge():
    whole = Spherical(1024, 512)
    truth = np.full((512, 1024), 10.0, np.float32)
    truth[:, 400:404] = 3.0  # as wide as 8 px of 2048
    truth[:, 640:] = 4.0
    levels = np.random.default_rng(0).integers(60, 200, (512, 1024, 3)).astype(np.uint8)
    classes = classify(levels, truth, whole, SE3.from_parts(np.eye(3), [0.0, 0.0, 50.0]))
    seen = {"thin": [399, 400, 403, 404], "edge": [637, 640, 642], "textured": [300, 634, 645, 800]}
    named = {name: np.unique(classes[256, columns]).tolist() for name, columns in seen.items()}
    assert named == {name: [CLASSES.index(name)] for name in seen}
