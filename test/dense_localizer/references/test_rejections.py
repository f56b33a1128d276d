"""Squares of key spheres that are rejected again and again: counted once a place, forgotten, written, left out."""

import numpy as np
import pytest

from dense_localizer.references.rejections import Rejections, locate_squares, read_rejections, select_forgotten
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.geometry.cameras.camera import pixel_grid
from sphere_nav.localization.status import State
from worlds.localizer import Run, at, make_localizer, make_map
from worlds.room import Room, wide_room

# Written out: imported, a change would go unseen.
SQUARE_COLUMNS, SQUARE_ROWS = 64, 32

MIN_SEEN = 8  # images in which a square was seen, before it may be forgotten


def test_squares_are_those_of_the_pixels():
    rejections, camera = Rejections(), Spherical(128, 64)
    rays = camera.unproject(pixel_grid(camera)).reshape(-1, 3)
    row, column = locate_squares(3.0 * rays)
    count = np.zeros((2, SQUARE_ROWS, SQUARE_COLUMNS), np.int64)
    count[:, 5, 40] = 10
    count[0] += 1
    rejections = Rejections({0: count})
    expected = ((row == 5) & (column == 40)).reshape(64, 128)
    np.testing.assert_array_equal(rejections.mask(0, camera), expected)
    window = Spherical(40, 30, 128.0, 70.0, 5.0)
    np.testing.assert_array_equal(rejections.mask(0, window), expected[5:35, 70:110])
    assert rejections.mask(1, camera) is None


def test_what_is_mostly_rejected_is_forgotten_but_never_too_much():
    count = np.zeros((2, SQUARE_ROWS, SQUARE_COLUMNS), np.int64)
    count[0, :4] = MIN_SEEN
    count[1, 0, :3] = MIN_SEEN  # always
    count[1, 1] = MIN_SEEN // 2  # half of the time
    assert np.argwhere(select_forgotten(count)).tolist() == [[0, 0], [0, 1], [0, 2]]
    count[1, :4] = MIN_SEEN
    assert np.count_nonzero(select_forgotten(count)) == int(0.3 * 4 * SQUARE_COLUMNS)
    count[0, :4] = count[1, :4] = MIN_SEEN - 1
    assert not select_forgotten(count).any()


def test_a_camera_that_waits_counts_once():
    rejections, rng = Rejections(), np.random.default_rng(1)
    points, residual = rng.normal(size=(500, 3)), rng.normal(size=500)
    assert rejections.is_due(0, np.zeros(3))
    rejections.add(0, np.zeros(3), points, residual)
    assert not rejections.is_due(0, np.array([0.1, 0.0, 0.0]))
    assert rejections.is_due(0, np.array([0.3, 0.0, 0.0]))


def test_a_square_is_rejected_where_most_of_at_least_four_points_are_outliers():
    """Beyond three deviations of at least one grey level, either way."""
    rays = Spherical(SQUARE_COLUMNS, SQUARE_ROWS).unproject(
        np.array([[3.0, 16.0], [9.0, 16.0], [20.0, 8.0], [50.0, 9.0], [60.0, 20.0]])
    )
    numbers, outliers = (3, 4, 4, 200, 5), ([9.0] * 3, [3.1, -3.1], [3.1, -3.1, 9.0], [2.9, -2.9], [])
    points = np.repeat(2.0 * rays, numbers, axis=0)
    residual = np.concatenate(
        [np.append(part, np.zeros(n - len(part))) for n, part in zip(numbers, outliers, strict=True)]
    )
    rejections = Rejections()
    for k in range(MIN_SEEN):
        assert rejections.add(7, np.zeros(3), points, residual + 5.0) == (k == MIN_SEEN - 1)  # others are forgotten now
    places = [(16, 3), (16, 9), (8, 20), (9, 50)]
    assert [rejections.counts[7][:, row, column].tolist() for row, column in places] == [[0, 0], [8, 0], [8, 8], [8, 0]]
    assert rejections.counts[7].sum() == 40
    assert rejections.share(8) == 0.0


def test_the_share_of_a_sphere_that_is_forgotten():
    count = np.zeros((2, SQUARE_ROWS, SQUARE_COLUMNS), np.int64)
    count[:, :2] = MIN_SEEN
    assert Rejections({0: count}).share(0) == int(0.3 * 2 * SQUARE_COLUMNS) / (SQUARE_ROWS * SQUARE_COLUMNS)


def test_counters_are_written_once_and_read_for_their_map_alone(tmp_path):
    rejections, path = Rejections(), tmp_path / "rejections.json"
    rejections.add(3, np.zeros(3), np.random.default_rng(1).normal(size=(500, 3)), np.zeros(500))
    rejections.write(path, "a map")
    np.testing.assert_array_equal(read_rejections(path, "a map").counts[3], rejections.counts[3])
    with pytest.raises(ValueError, match="not overwritten"):
        rejections.write(path, "a map")
    with pytest.raises(ValueError, match="expected other, found 'a map'"):
        read_rejections(path, "other")
    rejections.write(path, "a map", is_overwriting=True)
    with pytest.raises(ValueError, match="expected other, found 'a map'"):
        rejections.write(path, "other", is_overwriting=True)
    path.write_text("{}")
    with pytest.raises(ValueError, match="expected rejections"):
        rejections.write(path, "a map", is_overwriting=True)  # anything else is not replaced
    assert path.read_text() == "{}"
    with pytest.raises(ValueError, match="expected rejections"):
        read_rejections(path, "a map")


class ParkedRoom(Room):
    """The same room with something before a part of the wall that the camera looks at."""

    def __init__(self) -> None:
        super().__init__((5.0, 3.0, 1.5), (1.0, 20.0, 30), gain=30.0)

    def gray(self, points):
        is_hidden = (points[..., 0] > 4.9) & (np.abs(points[..., 1]) < 0.9)
        return np.where(is_hidden, 60.0 + 40.0 * np.sin(17.0 * points[..., 1]), super().gray(points))


def test_a_parked_car_is_forgotten_and_the_rest_is_not():
    room, there = wide_room(), ParkedRoom()
    localizer = make_localizer(make_map(room, [SE3.from_planar(x, 0.0, 0.0) for x in (-1.0, 1.0)]))
    run = Run(there, localizer)
    for k in range(110):
        last = run.see(at(-1.4 + 0.025 * k))
    assert last.status.state is State.TRACKING
    rejections, found = localizer.references.rejections, 0
    for sphere_id, x in ((0, -1.0), (1, 1.0)):
        squares = select_forgotten(rejections.counts[sphere_id])
        for row, column in np.argwhere(squares):
            azimuth = (0.5 - (column + 0.5) / SQUARE_COLUMNS) * 2.0 * np.pi
            assert abs(np.tan(azimuth) * (5.0 - x)) < 0.9 + 0.5  # it is there, give or take a square
            assert np.cos(azimuth) > 0.0
            assert 0 < row < SQUARE_ROWS - 1
            found += 1
    assert found >= 3
    localizer.references.close()
