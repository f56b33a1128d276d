"""One vocabulary: the words of the package are those of the message, and each localiser has advice for what it says.

Trust is earned, lowered and lost.
"""

from __future__ import annotations

from sphere_nav_msgs.msg import LocalizationStatus

import dense_localizer.reasons
import mcl_depth.status
from sphere_nav.localization import StateMachine
from sphere_nav.localization.params import StateParams
from sphere_nav.localization.status import (
    FINE,
    FOLLOWING,
    INPUT_REMEDIES,
    TRUSTED,
    Reason,
    State,
    Status,
    Verdict,
    describe_status,
    status_of,
)

CODES = {name.removeprefix("CODE_") for name in dir(LocalizationStatus) if name.startswith("CODE_")}


def test_words_and_fields_are_those_of_the_message():
    assert {*map(str, State), *map(str, Reason)} - {""} == CODES
    fields = set(LocalizationStatus.get_fields_and_field_types()) - {"header", "state_code", "reason_code"}
    assert set(vars(Status(State.LOST))) == fields | {"stamp_ns"}


def test_nobody_drives_by_a_pose_that_is_not_followed():
    assert set(TRUSTED) < set(FOLLOWING)
    assert State.LOST not in FOLLOWING


def test_a_status_leads_its_remedy_with_the_detail():
    for package in [dense_localizer.reasons, mcl_depth.status]:
        verdict = Verdict(Reason.OUTLIERS, 0.2, 0.4)
        plain = status_of(State.DEGRADED, 7, verdict, package.REMEDIES, quality=0.8, age=-1.0)
        assert plain.remedy == package.REMEDIES[Reason.OUTLIERS]
        assert (plain.state, plain.reason, plain.value, plain.limit) == ("DEGRADED", "OUTLIERS", 0.2, 0.4)
        assert (plain.stamp_ns, plain.quality, plain.age) == (7, 0.8, 0.0)
        detailed = status_of(State.LOST, 7, Verdict(Reason.OUTLIERS, detail="field"), package.REMEDIES)
        assert detailed.remedy == f"field; {plain.remedy}"
        assert describe_status(detailed) == f"LOST: OUTLIERS (0, limit 0): {detailed.remedy}"
        assert [describe_status(Status(State.LOST, remedy=text)) for text in ("", "wait")] == ["LOST", "LOST: wait"]
        advice = Verdict(Reason.BAD_INFO, detail="yuv", advice="send mono8")
        assert status_of(State.LOST, 7, advice, package.REMEDIES).remedy == "yuv; send mono8"


def test_what_to_do_about_the_input_is_the_same_in_both():
    for package in [dense_localizer.reasons, mcl_depth.status]:
        assert {reason: package.REMEDIES[reason] for reason in INPUT_REMEDIES} == INPUT_REMEDIES
        assert all(text for reason, text in package.REMEDIES.items() if reason)


def test_a_number_that_nobody_measured_reads_as_unknown():
    """A place that was not tested may as well be chance; a pose that nothing confirmed has no quality."""
    for status in (Status(State.SEARCHING), status_of(State.SEARCHING, 0, FINE)):
        assert (status.p_chance, status.quality, status.age, status.overlap, status.references) == (1.0, 0, 0, 0, ())
    told = status_of(State.TRACKING, 9, FINE, quality=0.75, p_chance=0.25, age=1.5)
    assert (told.quality, told.p_chance, told.age, told.stamp_ns) == (0.75, 0.25, 1.5, 9)


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


def test_a_loss_of_a_pose_that_is_found_again_was_none():
    machine = tracking()
    for is_found_again, num_losses in ((False, 1), (False, 2), (True, 2), (True, 2)):
        machine.lose()
        machine.start(is_found_again=is_found_again)
        assert (machine.state, machine.num_losses) == (State.PROBATION, num_losses)
    machine.start(is_found_again=True)
    machine.start(is_found_again=True)
    machine.start(is_found_again=True)
    assert machine.num_losses == 0


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
