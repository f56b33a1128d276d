"""Parameters of a node on the command line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import yaml


def parse_settings(settings: Sequence[str]) -> dict[str, Any]:
    """Return parameters from words NAME=VALUE; values as in YAML."""
    values = {}
    for word in settings:
        name, separator, text = word.partition("=")
        if not separator:
            raise ValueError(f"--set: expected NAME=VALUE, found {word!r}")
        values[name] = yaml.safe_load(text)
    return values
