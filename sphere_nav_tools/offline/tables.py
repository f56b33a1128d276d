"""What commands tell: tables as text, values as files of JSON, how far they are."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tqdm import tqdm

from sphere_nav_tools.offline.constants import EPOCHS_S

# where images could not be registered
REMEDY = "smaller steps between the images (slower, more a second), more range in them"


def columns(rows: Iterable[Sequence[str | int]]) -> list[str]:
    """Return a line for each row, the cells of a column below each other: words at the left, numbers at the right."""
    cells = list(rows)
    widths = [max(len(str(cell)) for cell in column) for column in zip(*cells, strict=True)]
    return ["  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)).rstrip() for row in cells]


def facts_as_lines(facts: Mapping[str, Any]) -> list[str]:
    """Return facts by name as one reads them, a line each; what has several parts with names, a line for each part."""
    rows = []
    for name, value in facts.items():
        has_parts = isinstance(value, list) and value and isinstance(value[0], Mapping)
        rows += [(name, _in_words(name, part)) for part in (value if has_parts else [value])]
    return columns(rows)


def _in_words(name: str, value: Any) -> str:
    """Return a value as text; stamps in s are dates (UTC), but those of a simulator, which begin at 0."""
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_in_words(key, one)}" for key, one in value.items()) or "none"
    if isinstance(value, list):
        return ", ".join(_in_words(name, one) for one in value) or "none"
    if name.endswith(("stamp_s", "served_s")) and value and value >= EPOCHS_S:
        return datetime.fromtimestamp(value, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None:
        return "none"
    return f"{value:g}" if isinstance(value, float) else str(value) or "none"


def quantity_lines(
    names: Iterable[str], values: Iterable[float], deviations: Iterable[float], unobserved: Collection[str]
) -> Iterator[str]:
    """Yield a line for each quantity that a drive tells: value and standard deviation, or that it does not tell it."""
    for name, value, sigma in zip(names, values, deviations, strict=True):
        note = "  NOT OBSERVED by this drive: as it was given" if name in unobserved else ""
        yield f"{name:<15}{value:12.5f} +- {sigma:.5f}{note}"


def progress(what: str, unit: str, of: Iterable[Any] | None = None, total: int | None = None) -> tqdm[Any]:
    """Return a bar on a terminal that shows how far a work is, the things `of` which it yields, or `total` steps."""
    return tqdm(of, desc=what, unit=unit, total=total, leave=False, disable=None)


def write_json(path: str | Path, values: object) -> None:
    """Write values as people read them."""
    Path(path).write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")
