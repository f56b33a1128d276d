"""NAME=VALUE on the command line."""

import argparse

import pytest

from sphere_nav_tools.offline.settings import add_settings


def parse(*words):
    parser = argparse.ArgumentParser()
    add_settings(parser, "a node")
    add_settings(parser, "another", "--set-other", "other")
    return parser.parse_args([part for option, word in words for part in (option, word)])


def test_values_are_read_as_yaml():
    words = ["a.b=3", "c=0.5", "d=false", "e=x=y", "f="]
    found = parse(*(("--set", word) for word in words), ("--set-other", "a.b=4"))
    assert found.settings == {"a.b": 3, "c": 0.5, "d": False, "e": "x=y", "f": None}
    assert found.other == {"a.b": 4}


def test_a_word_that_is_no_pair_is_refused_by_its_option():
    with pytest.raises(ValueError, match="--set-other: expected NAME=VALUE, found 'a'"):
        parse(("--set-other", "a"))
