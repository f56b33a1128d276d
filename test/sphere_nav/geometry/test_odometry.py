"""Two sources of one pose: when they are compared, and when they contradict each other."""

from __future__ import annotations

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.geometry.odometry import LIMIT, Agreement, difference

SECOND = 10**9
CERTAIN = np.diag([0.1, 0.1, 0.1, 0.02, 0.02, 0.02]) ** 2


def test_two_localizers_a_metre_apart_contradict_each_other() -> None:
    here = SE3.from_planar(0.0, 0.0, 0.0)
    places = [(0.3, 0.0, 0.0), (0.8, 0.0, 0.0), (0.0, 0.0, 0.5)]
    near, far, turned = (difference(here, CERTAIN, SE3.from_planar(*one), CERTAIN) for one in places)
    assert [one.is_contradiction for one in (near, far, turned)] == [False, True, True]
    assert far.meters == pytest.approx(0.8)
    assert f"limit {LIMIT:.1f}" in str(far)
    assert not difference(here, CERTAIN, SE3.from_planar(0.8, 0, 0), 0.1 * np.eye(6)).is_contradiction


def test_a_turned_localizer_is_unsure_along_its_own_axes() -> None:
    """It looks to the left and is unsure of its way ahead: along that they may be apart, across it not."""
    unsure = np.diag([1.0, 0.01, 0.01, 0.01, 0.01, 0.01]) ** 2
    sure = np.diag([0.01, 0.01, 0.01, 0.01, 0.01, 2.0]) ** 2
    ahead, across = np.array([np.cos(1.5), np.sin(1.5)]), np.array([-np.sin(1.5), np.cos(1.5)])
    for way, is_contradiction in ((ahead, False), (across, True)):
        other = SE3.exp([*(0.8 * way), 0.0, 0.0, 0.0, 1.5])
        assert difference(SE3.identity(), sure, other, unsure).is_contradiction == is_contradiction


def test_poses_are_compared_at_one_time() -> None:
    """Two vehicles' worth of stamps, 5 Hz and 2 Hz, one drive at 2 m/s: no difference, whoever comes first."""
    for first in [0, 1]:
        agreement = Agreement()
        news = [(0, k * SECOND // 5) for k in range(1, 20)] + [(1, k * SECOND // 2 + 7) for k in range(1, 8)]
        found = []
        for source, stamp in sorted(news, key=lambda item: (item[1] // SECOND, item[0] != first, item[1])):
            found.append(agreement.add(source, stamp, SE3.from_planar(2.0 * stamp / SECOND, 0.0, 0.0), CERTAIN))
        known = [item for item in found if item is not None]
        assert len(known) > 8
        assert max(item.meters for item in known) < 1e-6


def test_old_poses_say_nothing_of_now() -> None:
    agreement = Agreement(max_gap_s=1.0)
    agreement.add(0, SECOND, SE3.identity(), CERTAIN)
    assert agreement.add(1, 5 * SECOND, SE3.from_planar(9.0, 0, 0), CERTAIN) is None
    assert agreement.add(0, 9 * SECOND, SE3.identity(), CERTAIN) is None  # 8 s lie between: nobody knows
    assert agreement.add(0, 8 * SECOND, SE3.identity(), CERTAIN) is None  # backwards
    agreement.add(1, 9 * SECOND, SE3.identity(), CERTAIN)
    assert agreement.add(0, 9 * SECOND, SE3.from_planar(9.0, 0, 0), CERTAIN) is None  # the stamp of the last one
    agreement.clear()
    assert agreement.add(1, 9 * SECOND, SE3.identity(), CERTAIN) is None
