"""Numbers of text formats are finite, bounded and exact, whatever is written there."""

import pytest

from sphere_nav.geometry.files.untrusted import number, numbers, parse_stamp_ns


def test_a_number_however_it_is_written():
    for found in [1, 1.0, "1", "1e0", " 1 "]:
        assert number(found, "x") == 1.0


def test_what_is_no_number_is_one_short_line():
    for found in [
        "nan",
        "",
        "one",
        [1],
        10**400,
        "9" * 100,
    ]:
        with pytest.raises(ValueError, match="x: expected a finite number") as caught:
            number(found, "x")
        assert len(str(caught.value)) < 150


def test_a_list_has_the_length_that_is_asked_for():
    assert numbers([1, "2"], "x", 2) == (1.0, 2.0)
    for found in ([1], [1, 2, 3], "12", None):
        with pytest.raises(ValueError, match="x: expected"):
            numbers(found, "x", 2)


def test_a_stamp_keeps_its_nanoseconds():
    assert parse_stamp_ns("1700000000.123456789", "x") == 1_700_000_000_123_456_789
    assert parse_stamp_ns("0", "x") == 0
    assert parse_stamp_ns("1e-9", "x") == 1


def test_a_stamp_that_no_clock_gives():
    for word in ["1e999999999", "-1", "nan", "inf", "one", "2147483648", "1" * 10_000, "sNaN"]:
        with pytest.raises(ValueError, match="x: expected"):
            parse_stamp_ns(word, "x")
        with pytest.raises(ValueError, match=r"nanoseconds\?"):
            parse_stamp_ns("1700000000000000000", "x")
