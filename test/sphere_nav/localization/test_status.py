"""One vocabulary: the words of the package are those of the message, and each localiser has advice for what it says."""

from sphere_nav_msgs.msg import LocalizationStatus

import dense_localizer.reasons
import mcl_depth.status
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
