"""Parameters of a node on the command line."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Size
from sphere_nav.geometry.files.untrusted import load_yaml, number

PICTURES = (".png", ".pdf", ".svg")  # what figures are drawn as


class SettingAction(argparse.Action):
    """Collects words NAME=VALUE into a dictionary; values as in YAML. ValueError for a word that is no pair."""

    def __call__(self, parser: Any, namespace: argparse.Namespace, word: Any, option_string: str | None = None) -> None:
        """Add one word."""
        name, separator, text = word.partition("=")
        if not separator:
            raise ValueError(f"{option_string}: expected NAME=VALUE, found {word!r}")
        value = load_yaml(f"{option_string} {name}", text)
        setattr(namespace, self.dest, getattr(namespace, self.dest) | {name: value})


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
    parser.add_argument(
        option, action=SettingAction, default={}, metavar="NAME=VALUE", dest=dest, help=f"parameter of {node}"
    )


class FileAction(argparse.Action):
    """Takes a file to write, which must have one of some endings; `check_files` looks at it before any work begins.

    Its parser has --overwrite, too.
    """

    def __init__(self, option_strings: Sequence[str], dest: str, endings: Sequence[str] = (), **more: Any) -> None:
        super().__init__(option_strings, dest, **more)
        self._endings = endings

    def __call__(self, parser: Any, namespace: argparse.Namespace, path: Any, option_string: str | None = None) -> None:
        """Take one."""
        if self._endings and path.suffix not in self._endings:
            found = f"found ending {path.suffix!r}"
            raise argparse.ArgumentError(self, f"{path}: expected a file {', '.join(self._endings)}, {found}")
        setattr(namespace, self.dest, path)
        namespace.to_write = [*getattr(namespace, "to_write", ()), path]


def add_output(parser: argparse.ArgumentParser, metavar: str, what: str, endings: Sequence[str] = ()) -> None:
    """Declare the file that a command is for, and --overwrite."""
    how: dict[str, Any] = {"action": FileAction, "endings": endings, "type": Path, "metavar": metavar, "help": what}
    parser.add_argument("-o", "--output", required=True, **how)
    add_overwrite(parser)


def add_overwrite(parser: argparse.ArgumentParser) -> None:
    """Declare --overwrite."""
    parser.add_argument("--overwrite", action="store_true", help="replace what is there")


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
