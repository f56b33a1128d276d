"""The saliency order of M15 algorithm 1."""

import numpy as np

from photometric.saliency import saliency_rank


def test_each_column_gets_its_best_pixel_first(rng):
    points = rng.uniform(-5, 5, (3, 300)).astype(np.float32)
    gradient = rng.normal(size=(3, 300)).astype(np.float32)
    rank = saliency_rank(points, gradient)
    assert sorted(rank.tolist()) == list(range(300))
    J = np.abs(np.column_stack([gradient.T, np.cross(points.T, gradient.T)]))
    first = np.argsort(rank)[:6]
    taken: set[int] = set()
    for j, pixel in enumerate(first):
        rest = [i for i in range(300) if i not in taken]
        assert J[pixel, j] >= 0.99 * J[rest, j].max()  # the order is exact to 0.8 %
        taken.add(int(pixel))


def test_a_limit_keeps_the_same_first_places(rng):
    points = rng.uniform(-5, 5, (3, 600)).astype(np.float32)
    gradient = rng.normal(size=(3, 600)).astype(np.float32)
    full, half = saliency_rank(points, gradient), saliency_rank(points, gradient, limit=300)
    assert np.array_equal(np.argsort(full)[:200], np.argsort(half)[:200])
    assert sorted(half.tolist()) == list(range(600))


def test_pixels_that_fix_translation_and_rotation_are_both_among_the_best():
    near = np.tile([[0.0], [0.0], [1.0]], 50)
    far = np.tile([[0.0], [0.0], [1000.0]], 50)
    points = np.concatenate([near, far], axis=1).astype(np.float32)
    gradient = np.zeros((3, 100), np.float32)
    gradient[0, :50] = 100.0  # grey levels per metre fall with the distance
    gradient[0, 50:] = 0.2
    rank = saliency_rank(points, gradient)
    best = set(np.argsort(rank)[:10].tolist())
    assert best & set(range(50))
    assert best & set(range(50, 100))
