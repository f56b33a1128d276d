"""What a benchmark gives back: tables, and bounds with what was measured."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from datetime import date
from typing import Any

COLUMNS = ("what", "bound", "measured", "mark")
PAGE_GROUPS = (  # of docs/results.md
    "pose by image",
    "frame to frame",
    "drives and missions",
    "other light",
    "map",
    "bare geometry",
    "time to zero",
    "times and memory",
    "robustness",
)


@dataclass(frozen=True)
class Table:
    """A Markdown table; every row has as many cells as there are columns."""

    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]

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
class Headline:
    """That a bound has a row in docs/results.md: in which group, on which data, and the best figure of others there."""

    group: str  # of PAGE_GROUPS
    data: str  # recording or worlds; seed and size are added
    peer: str = ""  # the best peer or paper on the same data


@dataclass(frozen=True)
class Bound:
    """A figure to reach (DESIGN 7): `measured` must be at most `bound`, or at least where `is_minimum`."""

    what: str
    bound: float
    measured: float
    unit: str
    is_minimum: bool = False
    headline: Headline | None = None

    @property
    def is_met(self) -> bool:
        """Whether the bound holds; a figure that could not be measured does not meet it."""
        if math.isnan(self.measured):
            return False
        return self.measured >= self.bound if self.is_minimum else self.measured <= self.bound

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """Return what, bound, measured and mark as they are printed."""
        sign, mark = "≥" if self.is_minimum else "≤", "ok" if self.is_met else "RED"
        bound, measured = f"{sign} {self.bound:.4g} {self.unit}", f"{self.measured:.4g} {self.unit}"
        return self.what, bound.strip(), measured.strip(), mark


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
            rows: Sequence[tuple[str, ...]] = [bound.cells for bound in self.bounds]
            parts.append(Table("Bounds", COLUMNS, rows).markdown())
        return "\n\n".join([f"## {self.name}", *self.notes, *parts])

    def as_mapping(self) -> dict[str, Any]:
        """Return plain values for JSON; a bound with its cells as they are printed."""
        bounds = [asdict(bound) | {"cells": bound.cells} for bound in self.bounds]
        tables = [asdict(table) for table in self.tables]
        found = {"date": date.today().isoformat(), "bounds": bounds, "tables": tables}
        return found | {"notes": self.notes, "skipped": self.skipped}
