"""What a page or a help text tells the reader to type is understood: commands, options, parameters, topics."""

import argparse
import importlib
import re
import shlex
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import pairwise

import pytest

from architecture.tree import EXECUTABLES, ROOT, for_all
from sphere_nav.ros.compositions import COMPOSITIONS
from sphere_nav_tools.cli.main import COMMANDS

pytestmark = pytest.mark.slow  # loads every command

GENERATED = {"results.md", "parameters.md"}
PAGES = [ROOT / "README.md", *(page for page in sorted((ROOT / "docs").glob("*.md")) if page.name not in GENERATED)]
NOTES = sorted((ROOT / "docs" / "notes").glob("*.md"))
MODULES = {name: f"sphere_nav_tools.cli.{module}" for name, (module, _) in COMMANDS.items()}
NODES_OF_TOPICS = ("cycab_sim", "dense_localizer", "mcl_depth", "path_follower", "route_navigator")
NODES_OF_TOPICS += ("sphere_mapper",)  # and the stitcher, on the same page
FOLDERS = {"route_navigator": ("path_follower/ros",)}
FOLDERS |= {"sphere_mapper": ("sphere_mapping/ros", "sphere_mapping/acquisition/ros")}
BY_RCLPY = {"/tf", "/tf_static", "/clock"}


def blocks(text: str) -> Iterator[str]:
    """Yield the fenced and the indented blocks of a page."""
    yield from re.findall(r"^ *```\n(.*?)```", text, re.DOTALL | re.MULTILINE)
    unfenced = re.sub(r"^ *```.*?```", "", text, flags=re.DOTALL | re.MULTILINE)
    yield from re.findall(r"(?:^ {4,}\S.*\n)+", unfenced, re.MULTILINE)


def command_lines(text: str) -> Iterator[list[str]]:
    """Yield the words of each command line in blocks, without comments, continued lines joined."""
    for block in blocks(text):
        for line in re.sub(r"\\\n\s*", " ", block).splitlines():
            for part in re.split(r" && | \| ", line.strip()):
                if re.match(r"(?:\.venv/bin/)?sphere_nav |ros2 (?:run|launch) sphere_nav |\.venv/bin/\w+ ", part):
                    yield shlex.split(part, comments=True)


def words_of(lines: Iterator[list[str]]) -> Iterator[list[str]]:
    """Yield the words after `sphere_nav` of the lines that run it."""
    for words in lines:
        if words[:4] == ["ros2", "run", "sphere_nav", "sphere_nav"]:
            yield words[4:]
        elif words[0].removeprefix(".venv/bin/") == "sphere_nav":
            yield words[1:]


class _Refused(Exception):
    """What argparse says instead of leaving the program."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> None:  # type: ignore[override]
        raise _Refused(message)


@cache
def parser_of(command: str) -> argparse.ArgumentParser:
    parser = _Parser(prog=f"sphere_nav {command}", allow_abbrev=False)
    importlib.import_module(MODULES[command]).add_arguments(parser)
    return parser


def options(parser: argparse.ArgumentParser) -> set[str]:
    """Return all options of a command, of its subcommands too."""
    known = set()
    for action in parser._actions:
        known |= set(action.option_strings)
        if isinstance(action, argparse._SubParsersAction):
            known = known.union(*(options(part) for part in action.choices.values()))
    return known


def complaint(words: Sequence[str]) -> str:
    """Return what is wrong with the words after `sphere_nav`, or nothing."""
    if words and words[0] in ("--help", "--version"):
        return ""
    if not words or words[0] not in MODULES:
        return f"no such command: {' '.join(words)}"
    try:
        parser_of(words[0]).parse_args(list(words[1:]))
    except _Refused as refused:
        return f"{' '.join(words)}: {refused}"
    if words[0] == "up":
        return wrong_arguments(words[1], words[2:])
    return wrong_settings(words)


SETTINGS = {  # which node an option of a command gives a parameter to
    "map": {"--set": "sphere_mapper", "--set-stitcher": "sphere_stitcher"},
    "localize": {"--set": "dense_localizer"},
    "view": {"--set": "dense_localizer"},
    "mcl": {"--set": "mcl_depth"},
}


def wrong_settings(words: Sequence[str]) -> str:
    """Return a complaint about a parameter that `--set NAME=VALUE` gives to a node that has none of that name."""
    for option, value in pairwise(words):
        node = SETTINGS.get(words[0], {}).get(option)
        if node and value.split("=")[0] not in parameters()[node]:
            return f"{' '.join(words)}: {node} has no parameter {value.split('=')[0]}"
    return ""


def wrong_arguments(name: str, arguments: Sequence[str]) -> str:
    """Return a complaint about the arguments of a composition, or nothing."""
    if name not in COMPOSITIONS:
        return f"no composition {name}"
    known = COMPOSITIONS[name].arguments
    given = dict(argument.split(":=", 1) for argument in arguments if ":=" in argument)
    wrong = [argument for argument in given if argument not in known]
    if wrong:
        return f"{name} has no argument {wrong[0]}"
    missing = [word for word, argument in known.items() if argument.default is None and word not in given]
    return f"{name}: {missing[0]} must be given" if missing and "-s" not in arguments else ""


@cache
def parameters() -> dict[str, dict[str, str]]:
    """Return the default of each parameter, by node, as parameters.md tells."""
    tables: dict[str, dict[str, str]] = {}
    for part in re.split(r"^## ", (ROOT / "docs/parameters.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]:
        rows = re.findall(r"^- `([\w.]+): (.*?)`: ", part, re.MULTILINE)
        tables[part.split("\n", 1)[0]] = {name: default.strip('"') for name, default in rows}
    shared = tables.pop("Every node")
    return {node: shared | table for node, table in tables.items()}


def wrong_ros(words: Sequence[str]) -> str:
    """Return a complaint about `ros2 run` or `ros2 launch`, or about a node of `.venv/bin`, or nothing."""
    if words[1] == "launch":
        return wrong_arguments(words[3].removesuffix(".launch.py"), words[4:])
    node = words[3] if words[0] == "ros2" else words[0].removeprefix(".venv/bin/")
    if node not in EXECUTABLES:
        return f"no executable {node}"
    named = [value.split(":=")[0] for option, value in pairwise(words) if option == "-p"]
    wrong = [name for name in named if name not in parameters()[node] and name != "use_sim_time"]
    return f"{node} has no parameter {wrong[0]}" if wrong else ""


@for_all([*PAGES, *NOTES])
def test_commands_in_blocks_are_understood(page):
    lines = list(command_lines(page.read_text(encoding="utf-8")))
    wrong = [complaint(words) for words in words_of(iter(lines))]
    wrong += [wrong_ros(words) for words in lines if not list(words_of(iter([words])))]
    assert [line for line in wrong if line] == []


@for_all([*PAGES, *NOTES, ROOT / "CHANGELOG.md"])
def test_commands_in_sentences_exist_with_their_options(page):
    for command, rest in re.findall(r"`sphere_nav\s+([a-z][\w-]*)\b([^`]*)`", page.read_text(encoding="utf-8")):
        assert command in MODULES, command
        assert set(re.findall(r"(?<![\w-])--?[a-z][\w-]*", rest)) - options(parser_of(command)) == set(), command


@for_all(MODULES)
def test_examples_of_a_help_text_are_understood(command):
    module = importlib.import_module(MODULES[command])
    examples = (module.HELP + (parser_of(command).epilog or "")).split("examples:", 1)[1]
    found = list(words_of(command_lines(re.sub(r"^ +", "    ", examples, flags=re.MULTILINE) + "\n")))
    assert any(words[0] == command for words in found)
    assert [line for words in found if (line := complaint(words))] == []


@for_all(PAGES)
def test_parameters_in_tables_have_their_defaults(page):
    """A table that begins with `| parameter | default |` is of the node that heads its section, or the page."""
    for part in re.split(r"^## ", page.read_text(encoding="utf-8"), flags=re.MULTILINE):
        if "| parameter | default |" not in part:
            continue
        heading = re.match(r"\w+", part)
        node = heading[0] if heading and heading[0] in parameters() else page.stem
        table = part.split("| parameter | default |", 1)[1].split("\n\n", 1)[0]
        for names, defaults in re.findall(r"^\| (`[^|]*) \| ([^|]*) \|", table, re.MULTILINE):
            told = re.findall(r"`([\w.]+)`", names)
            group = told[0].rpartition(".")[0]
            full = [name if name in parameters()[node] else f"{group}.{name}" for name in told]
            values = defaults.replace("`", "").split(", ") if len(told) > 1 else [defaults.replace("`", "")]
            for name, value in zip(full, values * len(full) if len(values) == 1 else values, strict=True):
                assert _plain(value) == _plain(parameters()[node][name]), f"{node}: {name}"


def _plain(value: str) -> str:
    """Return a default as one can compare it: numbers by value, an empty text as `empty`."""
    try:
        return str(float(value))
    except ValueError:
        return value or "empty"


@for_all(NODES_OF_TOPICS)
def test_topics_in_tables_stand_in_the_shell_of_the_node(node):
    """Each name in the table of topics and services is a text in the `ros/` folders that make the node."""
    folders = [ROOT / folder for folder in (*FOLDERS.get(node, (f"{node}/ros",)), "sphere_nav/ros")]
    code = "\n".join(path.read_text(encoding="utf-8") for at in folders for path in at.rglob("*.py"))
    texts = set(re.findall(r"[\"'](?:{prefix})?([^\"'\n]+)[\"']", code))
    text = (ROOT / "docs" / f"{node}.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (?:in|out|service|action) \| ([^|]*) \|", text, re.MULTILINE)
    names = {name for cell in rows for name in re.findall(r"`([\w/~<>]+)`", cell.split("(")[0])}
    known = {part for name in texts for part in (name, name.rpartition("/")[2])}
    assert len(names) > 5
    assert {name for name in names if name.rpartition("/")[2] not in known} - BY_RCLPY == set()
