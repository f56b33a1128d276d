"""States and the only ways between them."""

import pytest

from path_follower.modes import FollowerState, Mode
from path_follower.reasons import FINE, StopReason, StopVerdict

LOST = StopVerdict(StopReason.NOT_LOCALISED)


def mode_in(state):
    mode = Mode()
    mode.load()
    if state is not FollowerState.IDLE:
        mode.arm()
    if state is FollowerState.PAUSED:
        mode.pause()
    if state is FollowerState.SLOW:
        mode.settle(is_standing=False, is_slow=True)
    if state is FollowerState.FINISHED:
        mode.finish()
    if state in (FollowerState.STOPPING, FollowerState.STOPPED):
        mode.halt(LOST)
    if state is FollowerState.STOPPED:
        mode.settle(is_standing=True, is_slow=False)
    assert mode.state is state
    return mode


def test_a_new_follower_has_no_path():
    assert Mode().state is FollowerState.NO_PATH
    assert not Mode().is_armed


@pytest.mark.parametrize("state", [FollowerState.DRIVING, FollowerState.SLOW, FollowerState.PAUSED])
def test_every_stop_disarms_and_keeps_its_reason(state):
    mode = mode_in(state)
    mode.halt(LOST)
    assert (mode.state, mode.verdict, mode.is_armed) == (FollowerState.STOPPING, LOST, False)
    mode.halt(StopVerdict(StopReason.OFF_PATH))
    assert mode.verdict is LOST
    mode.settle(is_standing=True, is_slow=False)
    assert (mode.state, mode.verdict) == (FollowerState.STOPPED, LOST)


@pytest.mark.parametrize("state", [FollowerState.STOPPED, FollowerState.FINISHED, FollowerState.IDLE])
def test_nothing_but_arm_leaves_a_rest(state):
    mode = mode_in(state)
    mode.pause()
    mode.halt(LOST)
    mode.finish()
    for is_slow in (False, True):
        mode.settle(is_standing=True, is_slow=is_slow)
    assert mode.state is state
    mode.arm()
    assert mode.is_driving


def test_all_fine_is_no_stop():
    mode = mode_in(FollowerState.DRIVING)
    mode.halt(FINE)
    assert mode.is_driving


def test_a_gentle_stop_becomes_hard_when_a_reason_comes_up():
    mode = mode_in(FollowerState.DRIVING)
    mode.halt(StopVerdict(StopReason.OPERATOR))
    assert not mode.is_stopping_hard
    mode.halt(LOST)
    assert mode.is_stopping_hard
    assert mode.verdict is LOST


def test_slow_follows_the_localisation():
    mode = mode_in(FollowerState.SLOW)
    assert mode.verdict.reason is StopReason.LOCALISATION_DEGRADED
    mode.settle(is_standing=False, is_slow=False)
    assert (mode.state, mode.verdict) == (FollowerState.DRIVING, FINE)


def test_the_words_are_those_of_the_message():
    messages = pytest.importorskip("sphere_nav_msgs.msg")
    for state in FollowerState:
        assert getattr(messages.FollowerStatus, state.value) == state.value
        assert isinstance(getattr(messages.FollowerStatus, f"CODE_{state.value}"), int)
    for reason in StopReason:
        assert not reason or getattr(messages.FollowerStatus, reason.value) == reason.value
