"""States and the only ways between them."""

import pytest

from path_follower.modes import Mode, State
from path_follower.reasons import FINE, Reason, Verdict

LOST = Verdict(Reason.NOT_LOCALISED)


def mode_in(state):
    mode = Mode()
    mode.load()
    if state is not State.IDLE:
        mode.arm()
    if state is State.PAUSED:
        mode.pause()
    if state is State.SLOW:
        mode.settle(is_standing=False, is_slow=True)
    if state is State.FINISHED:
        mode.finish()
    if state in (State.STOPPING, State.STOPPED):
        mode.halt(LOST)
    if state is State.STOPPED:
        mode.settle(is_standing=True, is_slow=False)
    assert mode.state is state
    return mode


def test_a_new_follower_has_no_path():
    assert Mode().state is State.NO_PATH
    assert not Mode().is_armed


@pytest.mark.parametrize("state", [State.DRIVING, State.SLOW, State.PAUSED])
def test_every_stop_disarms_and_keeps_its_reason(state):
    mode = mode_in(state)
    mode.halt(LOST)
    assert (mode.state, mode.verdict, mode.is_armed) == (State.STOPPING, LOST, False)
    mode.halt(Verdict(Reason.OFF_PATH))
    assert mode.verdict is LOST
    mode.settle(is_standing=True, is_slow=False)
    assert (mode.state, mode.verdict) == (State.STOPPED, LOST)


@pytest.mark.parametrize("state", [State.STOPPED, State.FINISHED, State.IDLE])
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
    mode = mode_in(State.DRIVING)
    mode.halt(FINE)
    assert mode.is_driving


def test_a_gentle_stop_becomes_hard_when_a_reason_comes_up():
    mode = mode_in(State.DRIVING)
    mode.halt(Verdict(Reason.OPERATOR))
    assert not mode.is_stopping_hard
    mode.halt(LOST)
    assert mode.is_stopping_hard
    assert mode.verdict is LOST


def test_slow_follows_the_localisation():
    mode = mode_in(State.SLOW)
    assert mode.verdict.reason is Reason.LOCALISATION_DEGRADED
    mode.settle(is_standing=False, is_slow=False)
    assert (mode.state, mode.verdict) == (State.DRIVING, FINE)


def test_the_words_are_those_of_the_message():
    messages = pytest.importorskip("sphere_nav_msgs.msg")
    for state in State:
        assert getattr(messages.FollowerStatus, state.value) == state.value
        assert isinstance(getattr(messages.FollowerStatus, f"CODE_{state.value}"), int)
    for reason in Reason:
        assert not reason or getattr(messages.FollowerStatus, reason.value) == reason.value
