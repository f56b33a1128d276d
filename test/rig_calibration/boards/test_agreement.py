"""Disagreement of a camera with itself is a matter of its deviations."""

from types import SimpleNamespace

import numpy as np
import pytest

from rig_calibration.boards.board import Board
from rig_calibration.boards.quality import disagreements, lens_chance
from rig_calibration.boards.views import BoardView
from rig_calibration.calibrate import check_views

COVARIANCE = np.diag([0.04, 0.04, 0.01, 0.01, *[0.0] * 8])  # the distortion is held


def single():
    lens = np.array([300.0, 300.0, 320.0, 240.0, *[0.0] * 8])
    return SimpleNamespace(lens=lens, lens_covariance=COVARIANCE)


def test_the_chance_of_a_change_is_that_of_its_deviations(rng):
    own = single()
    changes = rng.multivariate_normal(np.zeros(12), COVARIANCE, 2000)
    chances = np.array([lens_chance(own, own.lens + change) for change in changes])
    for level in (0.01, 0.1, 0.5):
        assert np.mean(chances < level) == pytest.approx(level, abs=4 * np.sqrt(level * (1 - level) / 2000))


def test_a_lens_that_changes_is_told_by_what_moved():
    own = single()
    moved = own.lens + np.array([0.1, -1.5, *[0.0] * 10])
    (line, _) = disagreements(["a", "b"], [own, own], np.stack([own.lens, moved]))
    assert line.startswith("b: by itself and with the others it is not the same camera: fx, fy, cx, cy moved by ")
    assert "-1.50" in line
    assert disagreements(["a", "b"], [own, own], np.stack([own.lens] * 2)) == []
    assert disagreements(["b"], [own], moved[None]) == []


BOARD = Board("b", 6, 4, 0.1)


def seen_by(camera, instant, count=24):
    return BoardView(camera, str(instant), "b", np.arange(count), np.zeros((count, 2)))


def test_what_is_missing_is_told_by_the_name_of_the_camera():
    good = [seen_by("a", n) for n in range(4)]
    check_views(["a"], [BOARD], good)
    for views, said in (
        ([], "expected a 6x4 chessboard in some images, found none in any"),
        (good, "camera b: expected a 6x4 chessboard in some of its images, found none"),
        ([*good, *(seen_by("b", n, 8 - (n == 2)) for n in range(4))], "in at least 4 of its images, found 3"),
    ):
        with pytest.raises(ValueError, match=said):
            check_views(["a", "b"], [BOARD], views)
    bad = seen_by("a", 9)
    bad.pixels[3, 1] = np.nan
    with pytest.raises(ValueError, match=f"view {bad.label}: expected finite corners of a known board"):
        check_views(["a"], [BOARD], [*good, bad])
