"""One vocabulary: the words of the package are those of the message, and each localiser has advice for what it says."""

import pytest
from sphere_nav_msgs.msg import LocalizationStatus

import dense_localizer.reasons
import mcl_depth.reasons
from localization.status import FOLLOWING, TRUSTED, Finding, Reason, State, Status

CODES = {name.removeprefix("CODE_") for name in dir(LocalizationStatus) if name.startswith("CODE_")}


def test_the_words_are_those_of_the_message():
    assert {*map(str, State), *map(str, Reason)} - {""} == CODES


def test_the_fields_are_those_of_the_message():
    fields = set(LocalizationStatus.get_fields_and_field_types()) - {"header", "state_code", "reason_code"}
    assert set(vars(Status(State.LOST))) == fields | {"stamp_ns"}


def test_what_is_trusted_is_followed():
    assert set(TRUSTED) < set(FOLLOWING)
    assert State.LOST not in FOLLOWING


@pytest.mark.parametrize("package", [dense_localizer.reasons, mcl_depth.reasons], ids=lambda p: p.__name__)
def test_a_finding_leads_its_advice_with_the_detail(package):
    finding = package.Finding(Reason.OUTLIERS, 0.2, 0.4, "field")
    assert isinstance(finding, Finding)
    assert finding.remedy == f"field; {package.REMEDIES[Reason.OUTLIERS]}"
    assert package.Finding(Reason.OUTLIERS).remedy == package.REMEDIES[Reason.OUTLIERS]
    assert package.FINE.remedy == ""
