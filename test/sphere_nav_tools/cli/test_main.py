"""The command: its table, its exit status, one line for every error; what is written, NAME=VALUE."""

import argparse
import types
from contextlib import suppress
from functools import partial
from pathlib import Path

import pytest

from sphere_nav_tools.cli import main as command
from sphere_nav_tools.cli import warm_up
from sphere_nav_tools.cli.main import COMMANDS, main
from sphere_nav_tools.offline.settings import FileAction, add, add_output, add_settings


@pytest.fixture
def stand_in(monkeypatch):
    """Put a module in the place of every subcommand; `stand_in.run` is what it does."""
    module = types.SimpleNamespace(HELP="Do something.\n\nexamples:\n  sphere_nav play x", run=lambda arguments: 0)
    module.add_arguments = lambda parser: parser.add_argument("bag", nargs="?")
    monkeypatch.setattr(command.importlib, "import_module", lambda name: module)
    return module


def raising(error):
    def run(arguments):
        raise error

    return run


def test_a_command_that_is_not_in_the_overview_is_not_found(capsys):
    assert main(["--help"]) == 0
    out = capsys.readouterr().out
    for name, (_, summary) in COMMANDS.items():
        assert f"  {name} " in out
        assert summary in out
    assert main([]) == 2


def test_every_command_has_help_with_examples(capsys):
    for name in COMMANDS:
        with pytest.raises(SystemExit) as end:
            main([name, "--help"])
        assert end.value.code == 0
        out = capsys.readouterr().out
        assert f"usage: sphere_nav {name}" in out
        assert f"  sphere_nav {name} " in out  # an example


def test_a_command_that_failed_is_not_taken_for_done(stand_in):
    for status in [0, 1]:
        stand_in.run = lambda arguments, status=status: status
        assert main(["play", "x"]) == status


def test_an_error_is_one_line(stand_in, capsys):
    for error, line in [
        (ValueError("drive: expected a bag,\n  found none"), "sphere_nav play: drive: expected a bag, found none\n"),
        (
            FileNotFoundError(2, "No such file or directory", "a.yaml"),
            "sphere_nav play: a.yaml: No such file or directory\n",
        ),
        (ValueError(), "sphere_nav play: ValueError\n"),
    ]:
        stand_in.run = raising(error)
        assert main(["play", "x"]) == 2
        assert capsys.readouterr().err == line


def test_a_wrong_word_is_one_line_and_a_place_behind_the_vehicle_no_option(stand_in, capsys):
    found = []
    stand_in.add_arguments = lambda parser: parser.add_argument("--mounting")
    stand_in.run = lambda arguments: found.append(arguments.mounting)
    for place in ["-0.1,0,1", "-.5", "-1"]:
        assert main(["play", "--mounting", place]) == 0
    assert found == ["-0.1,0,1", "-.5", "-1"]
    for words, line in [(["--mounting"], "--mounting: expected one argument"), (["--speed", "-1"], "--speed -1")]:
        with pytest.raises(SystemExit) as end:
            main(["play", *words])
        assert end.value.code == 2
        error = capsys.readouterr().err
        assert line in error
        assert error.count("\n") == 1


def test_a_mistake_of_ours_is_not_hidden_and_where_an_error_comes_from_can_be_seen(stand_in, monkeypatch):
    stand_in.run = raising(TypeError("mistake"))
    with pytest.raises(TypeError, match="mistake"):
        main(["play", "x"])
    stand_in.run = raising(ValueError("bad"))
    monkeypatch.setenv("SPHERE_NAV_DEBUG", "1")
    with pytest.raises(ValueError, match="bad"):
        main(["play", "x"])


def parse(*words):
    parser = argparse.ArgumentParser()
    add_settings(parser, "a node")
    add_settings(parser, "another", "--set-other", "other")
    return parser.parse_args([part for option, word in words for part in (option, word)])


def test_what_a_command_writes_is_looked_at_before_it_works(stand_in, tmp_path, monkeypatch, capsys):
    """A file is replaced only when told, a folder never; there must be a place for it, and its ending is known."""
    done = []

    def declare(parser):
        add_output(parser, "F", "file", (".png", ".svg"))
        add(parser, "--json", "F", "file", Path, action=FileAction)

    stand_in.add_arguments, stand_in.run = declare, lambda arguments: done.append(arguments.output.name)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.png").write_text("mine")
    (tmp_path / "a.svg").mkdir()
    for words, expected in {
        ("there.png",): "there.png: expected no such file, found one: --overwrite replaces it",
        ("a.png", "--json", "there.png"): "there.png: expected no such file, found one: --overwrite replaces it",
        ("a.svg", "--overwrite"): "a.svg: expected a file to write, found a folder",
        ("none/a.png",): "none/a.png: expected a folder to write it into, found no none",
        ("a.png", "--json", "none/a"): "none/a: expected a folder to write it into, found no none",
        ("a.txt",): "argument -o/--output: a.txt: expected a file .png, .svg, found ending '.txt' (--help explains)",
    }.items():
        with suppress(SystemExit):
            assert main(["play", "-o", *words]) == 2
        assert capsys.readouterr().err == f"sphere_nav play: {expected}\n"
    assert main(["play", "-o", "there.png", "--overwrite"]) == main(["play", "-o", "b.png", "--json", "a.txt"]) == 0
    assert done == ["there.png", "b.png"]


def test_values_are_read_as_yaml():
    words = ["a.b=3", "c=0.5", "d=false", "e=x=y", "f="]
    found = parse(*(("--set", word) for word in words), ("--set-other", "a.b=4"))
    assert found.settings == {"a.b": 3, "c": 0.5, "d": False, "e": "x=y", "f": None}
    assert found.other == {"a.b": 4}


def test_a_package_whose_kernels_do_not_compile_is_not_passed_over(monkeypatch):
    monkeypatch.setattr(warm_up, "PARTS", (partial(float, "none"),))
    with pytest.raises(ValueError, match="none"):
        warm_up.main()
