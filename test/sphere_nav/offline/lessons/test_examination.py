"""Where a map places a key image: searched around where it was, and what is elsewhere, or not sure, is no place."""

from types import SimpleNamespace

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.offline.lessons.examination import Marks, Placement, _place


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
        covariance = np.diag([self.sigma_m**2, 1e-10, 1e-10, 1.0, 1.0, 1.0])
        found = SimpleNamespace(T_map_camera=T, covariance=covariance, ncc=0.9, is_accepted=self.is_accepted)
        return SimpleNamespace(candidate=found if self.off_m < 5.0 else None)


def place(*arguments):
    one = SimpleNamespace(
        image=None, camera=None, stamp_ns=7, T_map_camera=SE3.from_planar(3.0, 1.0, 0.5),
        covariance=np.diag([1e-10, 0.01**2, 1e-10, 1.0, 1.0, 1.0]),
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


def test_medians_are_of_what_both_place():
    def marks(*off):
        return Marks(tuple(Placement(one, 0.2 * one, ncc) for one, ncc in off))

    before = marks((0.01, 0.79), (0.02, 0.8), (0.05, 0.9), (0.3, 0.9))
    after = marks((0.03, 0.9), (0.01, 0.9), (0.04, 0.9), (0.3, 0.7))
    assert (before.num_placed, before.num_explained, after.num_explained) == (4, 3, 3)
    assert before.compare(after) == pytest.approx((0.035, 0.035, 0.1 * 0.2 * 0.035))
    partly = Marks((None, *after.placements[1:3], None))
    assert before.compare(partly) == pytest.approx((0.035, 0.025, 0.1 * 0.2 * 0.035))
    assert before.compare(Marks((None,) * 4)) == (0.0, 0.0, 0.0)
