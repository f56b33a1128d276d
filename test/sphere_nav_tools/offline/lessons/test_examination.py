"""Where a map places a key image: searched around where it was, and what is elsewhere, or not sure, is no place."""

from types import SimpleNamespace

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav_tools.offline.lessons.examination import Marks, Placement, _place


class Localizer:
    """Places everything somewhere beside where it is looked for."""

    def __init__(self, off_m, sigma_m, is_accepted=True):
        self.off_m, self.sigma_m, self.is_accepted = off_m, sigma_m, is_accepted
        self.asked = []

    def reset(self):
        self.asked.append("reset")

    def relocalize(self, T):
        self.asked.append(T)
        if self.off_m is None:
            raise ValueError("no key sphere near")

    def update(self, image, camera, stamp_ns):
        T = self.asked[-1] @ SE3.from_planar(0.0, -self.off_m, 0.3)
        covariance = np.diag([self.sigma_m**2, 1e-6, 1e-6, 1.0, 1.0, 1.0])
        found = SimpleNamespace(T_map_camera=T, covariance=covariance, ncc=0.9, is_accepted=self.is_accepted)
        return SimpleNamespace(candidate=found if self.off_m < 5.0 else None)


def place(*arguments):
    one = SimpleNamespace(
        image=None, camera=None, stamp_ns=7, T_map_camera=SE3.from_planar(3.0, 1.0, 0.5),
        covariance=np.diag([1e-6, 0.01**2, 1e-6, 1.0, 1.0, 1.0]),
    )  # fmt: skip
    localizer = Localizer(*arguments)
    found = _place(localizer, one)
    assert localizer.asked == ["reset", one.T_map_camera]
    return found


@pytest.mark.parametrize(
    ("off_m", "sigma_m", "is_placed"),
    [(0.175, 0.02, True), (0.185, 0.02, False), (0.099, 0.001, True), (0.101, 0.001, False)],
)
def test_an_image_is_elsewhere_beyond_six_deviations_of_both_and_ten_centimetres(off_m, sigma_m, is_placed):
    found = place(off_m, sigma_m)
    assert (found is not None) == is_placed
    if is_placed:
        assert (found.off_m, found.sigma_m, found.ncc) == (pytest.approx(off_m), pytest.approx(sigma_m), 0.9)


def test_what_is_not_accepted_or_has_no_key_sphere_near_is_not_placed():
    assert place(0.01, 0.01, False) is None
    assert place(None, 0.01) is None
    assert place(9.0, 0.01) is None


def test_how_far_off_it_is_counts_in_deviations_of_both_along_each_axis_of_the_camera():
    found = place(0.05, 0.02)
    motion = SE3.from_planar(0.0, -0.05, 0.3)
    v, omega = motion.log()[:3], motion.log()[3:]
    expected = v[0] ** 2 / (0.02**2 + 1e-6) + v[1] ** 2 / (0.01**2 + 1e-6) + omega @ omega / 2.0
    assert found.squared == pytest.approx(expected)
    assert found.squared > 20.0


def marks(*squared, off_m=0.01, sigma_m=0.002, ncc=0.9):
    return Marks(tuple(None if one is None else Placement(off_m, one, sigma_m, ncc) for one in squared))


def test_what_is_placed_and_what_looks_like_the_map_are_counted():
    some = Marks((*marks(1.0, ncc=0.79).placements, None, *marks(1.0, ncc=0.8).placements))
    assert (some.num_placed, some.num_explained) == (2, 1)


FARTHER = "places key images 10.0 mm off, before 10.0 mm, more than both are uncertain"


# chi-squared exceeds 32.91 once in a thousand times for two images, 22.46 for one
@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        (marks(0.1, 0.1), marks(32.8, 0.1), ""),
        (marks(0.1, 0.1), marks(32.9, 0.1), FARTHER),
        (marks(30.0, 40.0), marks(40.0, 29.0), ""),  # the old one was no nearer
        (marks(0.1, 99.0), marks(22.4, None), "places 1 of 2 key images, before 2"),
        (marks(0.1, None), marks(22.4, 99.0), ""),  # one more is placed: that says nothing of where it was
        (marks(0.1, None), marks(22.5, 0.1), FARTHER),
        (marks(1.0, 1.0), marks(1.0, 1.0, sigma_m=0.0021), ""),  # 5 % less certain
        (
            marks(1.0, 1.0),
            marks(1.0, 1.0, sigma_m=0.0022),
            "places key images with a standard deviation of 2.2 mm, before 2.0 mm",
        ),
        (marks(None, None), marks(None, None), ""),
    ],
)
def test_worse_is_fewer_or_farther_than_both_are_uncertain_or_less_certain(before, after, words):
    assert before.find_worse(after) == words
