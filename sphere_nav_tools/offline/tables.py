"""What commands tell: tables as text, and values as files of JSON."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path


def columns(rows: Iterable[Sequence[str | int]]) -> list[str]:
    """Return a line for each row, the cells of a column below each other: words at the left, numbers at the right."""
    cells = list(rows)
    widths = [max(len(str(cell)) for cell in column) for column in zip(*cells, strict=True)]
    return ["  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)).rstrip() for row in cells]


def write_json(path: str | Path, values: object) -> None:
    """Write values as people read them."""
    Path(path).write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")
