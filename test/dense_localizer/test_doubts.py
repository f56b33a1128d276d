from dataclasses import replace

import numpy as np
import pytest

from dense_localizer.doubts import MAP_PHASE, PERIOD, Doubts
from dense_localizer.params import LocalizerParams
from dense_localizer.reference import References
from localization.status import State
from worlds.localizer import PINHOLE, STEP_NS, Run, at, drive, make_localizer


def test_every_image_is_looked_at_closely_until_the_pose_is_trusted(room_map):
    doubts = Doubts(References(room_map, LocalizerParams()), LocalizerParams())
    assert all(doubts.is_due(state) for state in State if state is not State.TRACKING)
    assert doubts.is_due(State.TRACKING)  # the first
    assert 0 < MAP_PHASE < PERIOD  # never both at once


def test_a_wrong_lens_never_tracks(room, room_map):
    run = Run(room, make_localizer(room_map))
    run.camera = replace(PINHOLE, fx=0.8 * PINHOLE.fx, fy=0.8 * PINHOLE.fy)
    for k, pose in enumerate(drive(15)):
        image = room.photograph(run.camera, pose, k)
        status = run.localizer.update(image, PINHOLE, (k + 1) * STEP_NS).status
        assert status.state not in (State.TRACKING, State.DEGRADED)


@pytest.mark.parametrize("has_jump", [False, True])
def test_a_jump_that_odometry_does_not_know_is_not_trusted(room, room_map, has_jump):
    localizer = make_localizer(room_map)
    states = []
    for k in range(34):
        x = -1.2 + 0.03 * k
        pose, T_odom = at(x + (0.35 if has_jump and k >= 12 else 0.0)), at(x)
        image = room.photograph(PINHOLE, pose, k)
        states.append(localizer.update(image, PINHOLE, (k + 1) * STEP_NS, T_odom).status.state)
    assert states[11] is State.TRACKING
    assert np.any([state is State.TRACKING for state in states[12:]]) != has_jump
