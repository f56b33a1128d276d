"""The status vocabulary, in words and codes."""

import enum
import math

import pytest
from sphere_nav_msgs.msg import LocalizationStatus

from sphere_nav.localization.status import Status
from sphere_nav.ros.conversions import message_to_status, status_to_message


def test_every_word_has_its_code_and_an_unknown_one_is_refused():
    words = [name.removeprefix("CODE_") for name in dir(LocalizationStatus) if name.startswith("CODE_")]
    assert "TRACKING" in words
    for word in words:
        message = status_to_message(Status(word, word), 0, "map")
        assert message.state_code == message.reason_code == getattr(LocalizationStatus, f"CODE_{word}")
        assert getattr(LocalizationStatus, word) == word
    with pytest.raises(ValueError, match="expected a state or reason of LocalizationStatus, found 'HAPPY'"):
        status_to_message(Status("HAPPY"), 0, "map")
    with pytest.raises(ValueError, match="found 'HAPPY'"):
        message_to_status(LocalizationStatus(state="HAPPY"))


def test_an_enum_is_its_word_and_nan_is_zero_but_as_a_chance_certain():
    state = enum.Enum("State", {"TRACKING": "TRACKING"})
    message = status_to_message(Status(state.TRACKING, mad=math.nan, value=math.inf), 0, "map")
    assert (message.state, message.reason_code, message.mad, message.value) == ("TRACKING", 0, 0.0, 0.0)
    message = status_to_message(Status("LOST", p_chance=math.nan, quality=math.nan), 0, "map")
    assert (message.p_chance, message.quality) == (1.0, 0.0)
