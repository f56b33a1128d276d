"""Trust is earned, lowered and lost."""

from sphere_nav.localization import State, StateMachine
from sphere_nav.localization.params import StateParams

PARAMS = StateParams(probation_images=3)
SECOND = 10**9


def started() -> StateMachine:
    machine = StateMachine(PARAMS)
    machine.reset()
    machine.search()
    machine.start()
    return machine


def confirm(machine: StateMachine, *goods: bool) -> list[State]:
    """Return the states after images that are good or not."""
    states = []
    for is_good in goods:
        machine.confirm(SECOND, is_good=is_good)
        states.append(machine.state)
    return states


def tracking() -> StateMachine:
    machine = started()
    assert confirm(machine, *[True] * machine.probation_images)[-1] is State.TRACKING
    return machine


def test_a_start_passes_through_search_and_probation():
    machine = StateMachine(PARAMS)
    seen = [(machine.state, machine.is_trusted)]
    for step in (machine.reset, machine.search, machine.start, *[lambda: confirm(machine, True)] * 3):
        step()
        seen.append((machine.state, machine.is_trusted))
    passed = [State.NOT_LOCALISED, State.NOT_LOCALISED, State.SEARCHING, *[State.PROBATION] * 3]
    assert seen == [*((state, False) for state in passed), (State.TRACKING, True)]


def test_a_poor_frame_starts_the_probation_again():
    states = confirm(started(), True, True, False, True, True, True)
    assert states == [State.PROBATION] * 5 + [State.TRACKING]


def test_an_image_may_count_for_several_or_for_none():
    machine = started()
    machine.confirm(SECOND, is_good=True, num_images=2)
    machine.confirm(SECOND, is_good=True, num_images=0)
    assert machine.state is State.PROBATION
    machine.confirm(SECOND, is_good=True, num_images=2)
    assert machine.state is State.TRACKING


def test_a_refused_image_on_probation_loses_the_pose_and_one_that_nobody_follows_cannot_be_lost():
    machine = started()
    machine.refuse(is_lost=False)
    assert (machine.state, machine.num_losses) == (State.LOST, 1)
    machine = StateMachine(PARAMS)
    machine.search()
    machine.refuse(is_lost=True)
    assert (machine.state, machine.num_losses) == (State.SEARCHING, 0)


def test_a_refused_image_or_doubt_degrades_and_good_ones_restore():
    machine = tracking()
    machine.refuse(is_lost=False)
    assert machine.state is State.DEGRADED
    assert machine.is_trusted
    assert confirm(machine, True, True) == [State.DEGRADED, State.TRACKING]
    assert confirm(machine, False, True, False, True, True) == [State.DEGRADED] * 4 + [State.TRACKING]


def test_a_pose_given_up_is_lost_and_not_found_again_by_images_that_confirm_nor_said_to_be_there_after_silence():
    machine = tracking()
    assert machine.after_silence is State.LOST
    machine.refuse(is_lost=True)
    assert machine.state is State.LOST
    assert not machine.is_trusted
    machine.withdraw()
    assert machine.after_silence is State.NOT_LOCALISED
    machine = tracking()
    machine.lose()
    assert confirm(machine, *[True] * 50) == [State.LOST] * 50
    assert not machine.is_following


def test_probation_lengthens_with_each_loss_up_to_its_bound():
    machine = tracking()
    lengths = [machine.probation_images]
    for _ in range(6):
        machine.lose()
        lengths.append(machine.probation_images)
    assert lengths == [3, 6, 12, 24, 48, 48, 48]


def test_a_loss_is_forgiven_after_a_minute_of_tracking_each_without_doubts_between():
    machine = tracking()
    for _ in range(2):
        machine.lose()
    machine.start()
    confirm(machine, *[True] * machine.probation_images)
    losses = []
    for second in (10, 70, 71, 131, 132, 999):  # tracking counts from the first image after the probation
        machine.confirm(second * SECOND, is_good=True)
        losses.append(machine.num_losses)
    assert losses == [2, 2, 1, 1, 0, 0]
    machine = tracking()
    machine.lose()
    machine.start()
    for second in range(1, 80):
        machine.confirm(second * SECOND, is_good=second % 40 > 0)
    assert machine.num_losses == 1
