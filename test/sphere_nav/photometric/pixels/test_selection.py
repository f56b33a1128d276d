"""Which pixels are aligned with an image (M15 eq. 16)."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.photometric import build_pyramid, prepare_reference
from sphere_nav.photometric.pixels.selection import choose_pixels, holds, select

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


def test_only_what_is_seen_is_made(room):
    image, range_m = room.render(SPHERE, A)
    made = prepare_reference(image, range_m, SPHERE)
    empty = made.num_bytes
    select(made.levels[1], T_CAMERA_BODY, CAMERA, 500)
    some = made.num_bytes
    assert empty < some
    for level in made.levels:
        level.squares.all()
    assert some - empty < 0.2 * (made.num_bytes - empty)


def test_a_selection_holds_for_a_tenth_of_the_width(reference):
    pixels = reference.levels[1]
    first = choose_pixels(pixels, T_CAMERA_BODY, CAMERA, 400)

    def turned(share):
        """Return the pose after a turn that moves the image by a share of its width."""
        return SE3.exp([0, 0, 0, 0, share * CAMERA.width / CAMERA.fx, 0]) @ T_CAMERA_BODY

    assert choose_pixels(pixels, turned(0.098), CAMERA, 400) is first
    assert not holds(pixels, turned(0.098), CAMERA, 400, 0.05)
    assert choose_pixels(pixels, turned(0.102), CAMERA, 400) is not first
    assert reference.num_bytes > first.blocks.nbytes


@pytest.mark.slow
def test_threads_see_the_same_squares(room):
    reference = prepare_reference(*room.render(SPHERE, A), SPHERE)
    turns = [SE3.exp([0, 0, 0, 0, 0.1 * k, 0]) @ T_CAMERA_BODY for k in range(60)]
    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(lambda T: select(reference.levels[0], T, CAMERA, 500), turns))
    alone = prepare_reference(*room.render(SPHERE, A), SPHERE)
    for T, one in zip(turns, found, strict=True):
        assert np.array_equal(one.blocks, select(alone.levels[0], T, CAMERA, 500).blocks, equal_nan=True)
