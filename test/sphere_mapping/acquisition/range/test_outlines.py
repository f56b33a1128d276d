import numpy as np

from sphere_mapping.acquisition.range.planes import bare_regions, cut_outlines

# Written out: imported, a change would go unseen.
AROUND_PX, HALF_PIECE_PX = 4, 5


def bare_square(rng):
    """Return a rough image (h, w) with a bare square across its seam, and the square."""
    image = rng.integers(60, 200, (128, 256)).astype(np.uint8)
    square = np.zeros(image.shape, np.bool_)
    square[40:80, :20], square[40:80, -20:] = True, True
    image[square] = 120
    return image, square


def test_a_bare_region_is_whole_where_the_columns_wrap_around(rng):
    image, square = bare_square(rng)
    nothing = np.full(image.shape, np.nan, np.float32)
    labels, boxes, seam = bare_regions(image, nothing, np.ones(image.shape, np.bool_), 0)
    assert len(boxes) == 1
    found = np.roll(labels, seam, axis=1) == boxes[0, 0]
    assert not np.any(found & ~square)
    assert found.sum() > 0.6 * square.sum()


def test_a_region_that_is_measured_or_not_usable_does_not_count(rng):
    image, _ = bare_square(rng)
    nothing, everywhere = np.full(image.shape, np.nan, np.float32), np.ones(image.shape, np.bool_)
    assert len(bare_regions(image, np.ones(image.shape, np.float32), everywhere, 0)[1]) == 0
    assert len(bare_regions(image, nothing, ~everywhere, 0)[1]) == 0


def test_pieces_lie_where_the_outline_runs_across_the_columns_and_do_not_overlap_much(rng):
    image, _ = bare_square(rng)
    image = np.roll(image, 60, axis=1)  # the square is in columns 40 to 80
    nothing = np.full(image.shape, np.nan, np.float32)
    labels, boxes, seam = bare_regions(image, nothing, np.ones(image.shape, np.bool_), 0)
    [outline] = cut_outlines(np.roll(image, -seam, axis=1), labels, boxes)
    middles = outline.corners + HALF_PIECE_PX
    middles[:, 1] = (middles[:, 1] + seam) % image.shape[1]
    assert len(middles) >= 6
    beside = np.minimum(np.abs(middles[:, 0] - 40), np.abs(middles[:, 0] - 80))
    assert np.all(beside <= 2 * AROUND_PX)  # above and below it, never left and right of it alone
    apart = np.abs(middles[:, None] - middles[None]).max(axis=-1) + 100 * np.eye(len(middles))
    assert apart.min() >= 5
    assert np.all(outline.masks.any(axis=(1, 2)))
