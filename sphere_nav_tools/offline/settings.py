"""How commands declare their arguments: files to write and parameters of nodes among them."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Size
from sphere_nav.geometry.files.untrusted import load_yaml, number

PICTURES = (".png", ".pdf", ".svg")  # what figures are drawn as
Container = argparse._ActionsContainer  # a parser, or a group of its arguments


def add(
    parser: Container,
    name: str,
    metavar: str | tuple[str, ...],
    told: str,
    kind: Callable[[str], Any] = str,
    **more: Any,
) -> None:
    """Declare what has a value: an option, or a word in its place. `more`: as argparse takes it."""
    parser.add_argument(name, metavar=metavar, help=told, type=kind, **more)


def flag(parser: Container, name: str, told: str) -> None:
    """Declare an option that is given or not."""
    parser.add_argument(name, action="store_true", help=told)


def choose(
    parser: Container, name: str, choices: Collection[str], told: str, default: str | None = None, **more: Any
) -> None:
    """Declare what is one of a few words."""
    parser.add_argument(name, choices=choices, default=default, help=told, **more)


class CollectAction(argparse.Action):
    """Adds to a dictionary what its `const` makes of the option and a word."""

    def __call__(self, parser: Any, namespace: argparse.Namespace, word: Any, option_string: str | None = None) -> None:
        """Add one word."""
        setattr(namespace, self.dest, getattr(namespace, self.dest) | self.const(self.option_strings[0], word))


def _read_setting(option: str, word: str) -> dict[str, Any]:
    """Return what a word NAME=VALUE sets, the value as in YAML; ValueError for a word that is no pair."""
    name, separator, text = word.partition("=")
    if not separator:
        raise ValueError(f"{option}: expected NAME=VALUE, found {word!r}")
    return {name: load_yaml(f"{option} {name}", text)}


def floats(expected: str, least: int, most: int = 0) -> Callable[[str], tuple[float, ...]]:
    """Return the type of an argument of so many finite numbers that are separated by commas."""

    def read(text: str) -> tuple[float, ...]:
        try:
            found = tuple(number(word.strip(), "") for word in text.split(","))
        except ValueError:
            found = ()
        if not least <= len(found) <= max(least, most):
            raise argparse.ArgumentTypeError(f"expected {expected}, found {text!r}")
        return found

    return read


def read_pose(text: str) -> SE3:
    """Return the pose of an argument x,y,z,qx,qy,qz,qw."""
    values = floats("x,y,z,qx,qy,qz,qw", 7)(text)
    try:
        return SE3.from_quaternion(values[3:], values[:3])
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"expected x,y,z,qx,qy,qz,qw, found {text!r}: {error}") from None


def read_positive(text: str) -> float:
    """Return the finite positive number of an argument."""
    (found,) = floats("a positive number", 1)(text)
    if found <= 0:
        raise argparse.ArgumentTypeError(f"expected a positive number, found {text}")
    return found


def read_count(text: str) -> int:
    """Return the whole number, 1 or more, of an argument."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"expected at least 1, found {text}")
    return int(text)


def read_size(text: str) -> Size:
    """Return width and height of an argument WxH, pixels."""
    found = re.fullmatch(r"(\d+)[x×](\d+)", text)
    if found is None or "0" in found.groups():
        raise argparse.ArgumentTypeError(f"expected WIDTHxHEIGHT such as 640x480, found {text!r}")
    return int(found[1]), int(found[2])


def add_settings(parser: argparse.ArgumentParser, node: str, option: str = "--set", dest: str = "settings") -> None:
    """Declare an option that sets parameters of a node, as often as it is given."""
    how: dict[str, Any] = {"action": CollectAction, "const": _read_setting, "default": {}, "dest": dest}
    add(parser, option, "NAME=VALUE", f"parameter of {node}", **how)


class FileAction(argparse.Action):
    """Takes a file to write, which must have one of the endings that are its `const`; any, where there are none.

    `check_files` looks at it before any work begins. Its parser has --overwrite, too.
    """

    def __call__(self, parser: Any, namespace: argparse.Namespace, path: Any, option_string: str | None = None) -> None:
        """Take one."""
        if self.const and path.suffix not in self.const:
            found = f"found ending {path.suffix!r}"
            raise argparse.ArgumentError(self, f"{path}: expected a file {', '.join(self.const)}, {found}")
        setattr(namespace, self.dest, path)
        namespace.to_write = [*getattr(namespace, "to_write", ()), path]


def add_output(parser: argparse.ArgumentParser, metavar: str, what: str, endings: Sequence[str] = ()) -> None:
    """Declare the file that a command is for, and --overwrite."""
    how: dict[str, Any] = {"action": FileAction, "const": endings, "type": Path, "metavar": metavar, "help": what}
    parser.add_argument("-o", "--output", required=True, **how)
    add_overwrite(parser)


def add_overwrite(parser: argparse.ArgumentParser) -> None:
    """Declare --overwrite."""
    flag(parser, "--overwrite", "replace what is there")


def check_files(arguments: argparse.Namespace) -> None:
    """Raise ValueError for a file to write that has no folder to be in, or is there, without --overwrite."""
    for path in getattr(arguments, "to_write", ()):
        check_free(arguments, path)
        if not path.parent.is_dir():
            raise ValueError(f"{path}: expected a folder to write it into, found no {path.parent}")


def check_free(arguments: argparse.Namespace, path: Path, loss: str = "") -> None:
    """Raise ValueError where a file to write is there, without --overwrite; `loss`: what else would go."""
    if path.is_dir():
        raise ValueError(f"{path}: expected a file to write, found a folder")
    if path.exists() and not arguments.overwrite:
        raise ValueError(f"{path}: expected no such file, found one: --overwrite replaces it{loss}")
