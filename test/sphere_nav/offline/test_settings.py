"""NAME=VALUE on the command line."""

import pytest

from sphere_nav.offline.settings import parse_settings


def test_values_are_read_as_yaml():
    words = ["a.b=3", "c=0.5", "d=false", "e=x=y", "f="]
    assert parse_settings(words) == {"a.b": 3, "c": 0.5, "d": False, "e": "x=y", "f": None}


def test_a_word_that_is_no_pair_is_refused():
    with pytest.raises(ValueError, match="expected NAME=VALUE, found 'a'"):
        parse_settings(["a"])
