"""How arguments are declared: values, flags, choices; in the place of a word or behind an option."""

from argparse import ArgumentError, ArgumentParser
from pathlib import Path

import pytest

from sphere_nav_tools.cli.arguments import add, choose, flag


def parse(*words):
    parser = ArgumentParser(exit_on_error=False)
    add(parser, "bag", "BAG", "a recording", Path)
    add(parser, "--rate", "X", "speed (%(default)g)", float, default=1.0)
    flag(parser, "--clock", "publish /clock")
    choose(parser, "--align", ("none", "poses"), "how (%(default)s)", "none")
    return parser.parse_args(words), parser.format_help()


def test_arguments_have_their_type_their_default_and_help():
    given, told = parse("drive", "--rate", "0.5", "--align", "poses")
    assert vars(given) == {"bag": Path("drive"), "rate": 0.5, "clock": False, "align": "poses"}
    assert vars(parse("drive", "--clock")[0]) == {"bag": Path("drive"), "rate": 1.0, "clock": True, "align": "none"}
    for words in ("BAG", "a recording", "--rate X", "speed (1)", "publish /clock", "how (none)"):
        assert words in told
    with pytest.raises(ArgumentError, match="--align: invalid choice"):
        parse("drive", "--align", "scale")
