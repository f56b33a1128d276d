"""Which pixels are aligned with an image (M15 eq. 16)."""

import numpy as np
import pytest

from photometric import build_pyramid, prepare_reference
from photometric.iteration.kernels import SIDE
from photometric.selection import choose, select, visible
from sphere_geometry import SE3, Pinhole, Spherical

CAMERA = Pinhole(160, 120, 110.0, 110.0, 79.5, 59.5)
SPHERE = Spherical(1024, 512)
T_CAMERA_BODY = SE3.from_parts([[0, -1, 0], [0, 0, -1], [1, 0, 0]], [0, 0, 0])
A = SE3.from_planar(0.5, -0.4, 0.3)


@pytest.fixture(scope="module")
def reference(room):
    image, range_m = room.render(SPHERE, A)
    return prepare_reference(image, range_m, SPHERE)


@pytest.fixture(scope="module")
def levels():
    return build_pyramid(np.zeros((120, 160), np.uint8), CAMERA).levels


def test_the_reference_level_matches_the_resolution_of_the_image(reference, levels):
    assert reference.level_like(levels[0].camera).camera.width == 512  # 163 px/rad halved once is nearest to 110
    assert reference.level_like(levels[1].camera).camera.width == 256


def test_only_pixels_that_the_camera_sees_are_chosen(reference, levels):
    pixels = reference.levels[1]
    seen = visible(pixels, T_CAMERA_BODY, levels[0])
    expected = CAMERA.project(T_CAMERA_BODY.apply(pixels.points.T))
    inside = np.all((expected[0] >= 0) & (expected[0] <= (159, 119)), axis=-1)
    off = np.setxor1d(seen, np.flatnonzero(inside))
    assert off.size < 1e-3 * pixels.num_pixels  # float32 at the border
    assert select(pixels, T_CAMERA_BODY, levels[0], 10**6).num_pixels == seen.size


def test_the_best_pixels_by_rank_are_chosen_when_there_are_too_many(reference, levels):
    pixels = reference.levels[1]
    seen = visible(pixels, T_CAMERA_BODY, levels[0])
    chosen = select(pixels, T_CAMERA_BODY, levels[0], 500)
    best = np.sort(seen[np.argsort(pixels.rank[seen])[:500]])
    points = chosen.blocks.reshape(-1, 7, SIDE)[:, :3].transpose(1, 0, 2).reshape(3, -1)
    assert chosen.num_pixels == 500
    assert np.array_equal(points[:, :500], pixels.points[:, best])


def test_a_selection_is_kept_while_the_image_moves_little(reference, levels):
    pixels = reference.levels[1]
    first = choose(pixels, T_CAMERA_BODY, levels[0], 400)
    near = choose(pixels, SE3.exp([0.01, 0, 0, 0, 0.01, 0]) @ T_CAMERA_BODY, levels[0], 400)
    turned = choose(pixels, SE3.exp([0, 0, 0, 0, 0.3, 0]) @ T_CAMERA_BODY, levels[0], 400)
    assert near is first
    assert turned is not first
