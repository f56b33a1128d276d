import pytest

from dense_localizer.params import StateParams
from dense_localizer.status import StateMachine
from localization.status import State

PARAMS = StateParams(probation_frames=3, max_probation_frames=8, recovery_frames=2, max_blind_s=0.5)


def started() -> StateMachine:
    machine = StateMachine(PARAMS)
    machine.reset()
    machine.search()
    machine.start()
    return machine


def tracking() -> StateMachine:
    machine = started()
    for _ in range(machine.probation_frames):
        machine.align(is_good=True)
    assert machine.state is State.TRACKING
    return machine


def test_a_start_passes_through_search_and_probation():
    machine = StateMachine(PARAMS)
    seen = [machine.state]
    machine.reset()
    seen.append(machine.state)
    machine.search()
    seen.append(machine.state)
    machine.start()
    for _ in range(3):
        seen.append(machine.state)
        assert not machine.is_trusted
        machine.align(is_good=True)
    seen.append(machine.state)
    expected = [State.NOT_LOCALISED, State.NOT_LOCALISED, State.SEARCHING, *[State.PROBATION] * 3, State.TRACKING]
    assert seen == expected
    assert machine.is_trusted


def test_a_poor_frame_starts_the_probation_again():
    machine = started()
    machine.align(is_good=True)
    machine.align(is_good=True)
    machine.align(is_good=False)
    machine.align(is_good=True)
    machine.align(is_good=True)
    assert machine.state is State.PROBATION
    machine.align(is_good=True)
    assert machine.state is State.TRACKING


def test_a_refused_frame_in_probation_loses_the_pose():
    machine = started()
    machine.refuse(blind_s=0.03, is_certain=True)
    assert machine.state is State.LOST


def test_a_refused_frame_degrades_and_good_ones_restore():
    machine = tracking()
    machine.refuse(blind_s=0.03, is_certain=True)
    assert machine.state is State.DEGRADED
    assert machine.is_trusted
    machine.align(is_good=True)
    assert machine.state is State.DEGRADED
    machine.align(is_good=True)
    assert machine.state is State.TRACKING


@pytest.mark.parametrize(("blind_s", "is_certain"), [(0.51, True), (0.1, False)])
def test_blind_too_long_or_too_uncertain_is_lost(blind_s, is_certain):
    machine = tracking()
    machine.refuse(0.05, True)
    machine.refuse(blind_s, is_certain)
    assert machine.state is State.LOST
    assert not machine.is_trusted


def test_probation_lengthens_with_each_loss_up_to_its_bound():
    machine = tracking()
    lengths = [machine.probation_frames]
    for _ in range(4):
        machine.lose()
        machine.search()
        machine.start()
        lengths.append(machine.probation_frames)
    assert lengths == [3, 6, 8, 8, 8]


def test_a_long_good_drive_forgives_a_loss():
    machine = tracking()
    machine.lose()
    machine.search()
    machine.start()
    for _ in range(6):
        machine.align(is_good=True, step_s=1.0)
    assert machine.num_losses == 1
    for _ in range(62):
        machine.align(is_good=True, step_s=1.0)
    assert machine.num_losses == 0


def test_a_reset_forgets_the_losses():
    machine = tracking()
    machine.lose()
    machine.reset()
    assert (machine.state, machine.probation_frames) == (State.NOT_LOCALISED, 3)
