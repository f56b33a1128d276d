"""Tables as text."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def columns(rows: Iterable[Sequence[str | int]]) -> list[str]:
    """Return a line for each row, the cells of a column below each other: words at the left, numbers at the right."""
    cells = list(rows)
    widths = [max(len(str(cell)) for cell in column) for column in zip(*cells, strict=True)]
    return ["  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)).rstrip() for row in cells]
