"""What a benchmark gives back: tables, and bounds with what was measured."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class Table:
    """A Markdown table; every row has as many cells as there are columns."""

    title: str
    columns: tuple[str, ...]
    rows: list[tuple[str, ...]]

    def markdown(self) -> str:
        """Return the table with its columns padded, so that it reads in a terminal too."""
        lines = [self.columns, *self.rows]
        widths = [max(len(line[i]) for line in lines) for i in range(len(self.columns))]
        text = [
            "| " + " | ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) + " |"
            for line in lines
        ]
        text.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
        return "\n".join([f"### {self.title}", "", *text])


@dataclass(frozen=True)
class Bound:
    """A figure to reach (DESIGN 7): `measured` must be at most `bound`, or at least where `is_minimum`."""

    what: str
    bound: float
    measured: float
    unit: str
    is_minimum: bool = False

    @property
    def is_met(self) -> bool:
        """Whether the bound holds; a figure that could not be measured does not meet it."""
        if math.isnan(self.measured):
            return False
        return self.measured >= self.bound if self.is_minimum else self.measured <= self.bound


@dataclass
class Report:
    """Everything one benchmark found; `skipped` says why it measured nothing."""

    name: str
    tables: list[Table] = field(default_factory=list)
    bounds: list[Bound] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    skipped: str = ""

    def markdown(self) -> str:
        """Return all tables, the bounds with their marks, and the notes."""
        if self.skipped:
            return f"## {self.name}\n\nSkipped: {self.skipped}"
        parts = [table.markdown() for table in self.tables]
        if self.bounds:
            parts.append(bounds_table(self.bounds).markdown())
        return "\n\n".join([f"## {self.name}", *self.notes, *parts])

    def as_mapping(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {**asdict(self), "bounds": [asdict(bound) | {"is_met": bound.is_met} for bound in self.bounds]}


def bounds_table(bounds: list[Bound]) -> Table:
    """Set bounds beside what was measured, with 'ok' or 'RED'."""
    rows: list[tuple[str, ...]] = [
        (
            b.what,
            f"{'≥' if b.is_minimum else '≤'} {b.bound:.4g} {b.unit}",
            f"{b.measured:.4g} {b.unit}",
            "ok" if b.is_met else "RED",
        )
        for b in bounds
    ]
    return Table("Bounds", ("what", "bound", "measured", "mark"), rows)
