"""New particles for a belief that loses its lead, and none for one that keeps it."""

from __future__ import annotations

import numpy as np
import pytest

from mcl_depth.belief.recovery import Recovery
from mcl_depth.params import RecoveryParams

PARAMS = RecoveryParams()


@pytest.fixture
def recovery():
    return Recovery(PARAMS, np.zeros((0, 2)))


def test_who_is_lost_gets_the_share_of_the_lost(recovery) -> None:
    assert recovery.share(is_following=False) == PARAMS.lost_share


def test_a_lead_that_varies_costs_nothing_and_one_that_vanishes_brings_new_particles(recovery) -> None:
    recovery.slow, recovery.fast = 3.3, 2.5  # as light and texture change on the way
    assert recovery.share(is_following=True) == 0.0
    recovery.fast = 0.5
    assert recovery.share(is_following=True) == PARAMS.max_share
    recovery.fast = 0.9 * PARAMS.fall * recovery.slow
    assert recovery.share(is_following=True) == pytest.approx(0.1)


def test_switched_off_it_brings_none() -> None:
    still = Recovery(RecoveryParams(is_active=False), np.zeros((0, 2)))
    assert still.share(is_following=False) == 0.0
