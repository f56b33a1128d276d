"""Only what is the same in both cameras is compared."""

import numpy as np
import pytest

from sphere_mapping.acquisition.stitching.overlaps import is_same_detail, share_of

EVERYWHERE = np.ones((40, 60), np.bool_)
INNER = np.s_[8:-8, 8:-8]


@pytest.fixture
def detail(rng):
    return np.kron(rng.normal(4.5, 0.3, (20, 30)), np.ones((2, 2))).astype(np.float32)


def test_the_same_detail_in_another_light_is_the_same(rng, detail):
    noise = rng.normal(0, 0.03, detail.shape).astype(np.float32)
    assert (
        is_same_detail(detail, detail - np.float32(0.7) + noise, EVERYWHERE, share_of(EVERYWHERE))[INNER].mean() > 0.98
    )


def test_other_detail_is_not_the_same(rng, detail):
    other = rng.permutation(detail.ravel()).reshape(detail.shape)
    assert is_same_detail(detail, other, EVERYWHERE, share_of(EVERYWHERE)).mean() < 0.02
    assert not is_same_detail(detail, np.full_like(detail, 4.5), EVERYWHERE, share_of(EVERYWHERE))[INNER].any()


def test_bare_walls_are_compared(rng):
    walls = [
        np.full((40, 60), level, np.float32) + rng.normal(0, 0.01, (40, 60)).astype(np.float32) for level in (4, 5)
    ]
    assert is_same_detail(*walls, EVERYWHERE, share_of(EVERYWHERE)).all()


def test_what_one_camera_does_not_see_is_not_compared(detail):
    both = EVERYWHERE.copy()
    both[:, 30:] = False
    assert not is_same_detail(detail, detail, both, share_of(both))[:, 30:].any()
