"""What an experiment found: figures beside their bounds, as `result.json` and as a table."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class JudgedFigure:
    """A measured value and its bound: at most that much, or at least with `is_minimum`; without one it is only told."""

    name: str
    value: float
    unit: str = ""
    bound: float | None = None
    is_minimum: bool = False

    @property
    def is_met(self) -> bool:
        """Whether the value keeps its bound; what is no number does not."""
        if self.bound is None:
            return True
        return bool(self.value >= self.bound if self.is_minimum else self.value <= self.bound)


def write_result(
    folder: Path, name: str, seed: int, figures: Sequence[JudgedFigure], more: Mapping[str, Any] | None = None
) -> bool:
    """Write `result.json`, print the table, and return whether every bound is kept; `more`: what else is told."""
    has_passed = all(figure.is_met for figure in figures)
    told = [
        asdict(figure) | {"is_met": figure.is_met} | ({} if math.isfinite(figure.value) else {"value": None})
        for figure in figures
    ]  # JSON knows no infinity
    result = {"experiment": name, "seed": seed, "has_passed": has_passed, "figures": told} | dict(more or {})
    (folder / "result.json").write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    print("\n".join([*map(_row, figures), f"{'all of it':<44} {folder}"]))
    print(f"{name}, seed {seed}: {'every bound is kept' if has_passed else 'NOT EVERY BOUND IS KEPT'}")
    return has_passed


def _row(figure: JudgedFigure) -> str:
    bound = "" if figure.bound is None else f"({'at least' if figure.is_minimum else 'at most'} {figure.bound:g})"
    return (
        f"{figure.name:<44} {figure.value:8.3f} {figure.unit:<4} {bound:<18} {'' if figure.is_met else 'RED'}".rstrip()
    )
