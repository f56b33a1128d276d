"""How commands declare their arguments; files to write and parameters of nodes: `offline/settings.py`."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Collection
from typing import Any

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
