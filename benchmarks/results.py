"""`python -m benchmarks.results [FOLDER]`: docs/results.md from the JSON files of the benchmarks (`make bench-report`).

A row is a bound that its benchmark calls a headline. RED ones come first; what is beyond 45 rows and met is counted.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.report import PAGE_GROUPS

PAGE = Path(__file__).resolve().parents[1] / "docs" / "results.md"
COLUMNS = ("group", "what", "value", "bound", "mark", "best peer or paper", "data, size, seed", "commit", "date")
MAX_ROWS = 45
INTRODUCTION = """\
# Results

Written by `make bench-report` from what `make bench` left in out/bench; why a figure is as it is stands on
docs/notes/. RED: the bound is not met. Worlds are drawn by the seed, which no parameter was chosen by. Recordings are
read from `../shared/data`. Redkitchen is judged by COLMAP's poses, right to about 5 mm and 0.2°; its recorded ones are
wrong ([why](notes/ground_truth.md)).
"""

Row = tuple[str, ...]


def main(folder: Path) -> int:
    """Write the page anew."""
    found = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("*.json"))]
    if not found:
        print(f"{folder}: expected JSON files of benchmarks, found none", file=sys.stderr)
        return 2
    PAGE.write_text(write_page(found), encoding="utf-8")
    return 0


def rows_of(entry: dict[str, Any]) -> list[Row]:
    """Return the rows of one benchmark's JSON."""
    rows: list[Row] = []
    for bound in entry["bounds"]:
        if not (headline := bound["headline"]):
            continue
        what, limit, measured, mark = bound["cells"]
        data = f"{headline['data']}, {entry['size']}, {entry['seed']}"
        told = (headline["group"], what, measured, limit, mark, headline["peer"] or "—", data)
        rows.append((*told, entry["commit"], entry["date"]))
    return rows


def write_page(found: list[dict[str, Any]]) -> str:
    """Return the page: the rows, and for each group what measured it."""
    rows = [row for entry in found for row in rows_of(entry)]
    rows.sort(key=lambda row: (row[COLUMNS.index("mark")] != "RED", PAGE_GROUPS.index(row[0])))
    reds = sum(row[COLUMNS.index("mark")] == "RED" for row in rows)
    shown = rows[: max(MAX_ROWS, reds)]
    machines = sorted({entry["machine"].split(";")[0] for entry in found})
    commands = [(group, ", ".join(_commands(group, found))) for group in PAGE_GROUPS if _commands(group, found)]
    count = f"{len(shown)} of {len(rows)} figures, {reds} RED; the others are met."
    parts = [INTRODUCTION, _table(COLUMNS, shown), f"{count} Measured on: {'; '.join(machines)}.\n"]
    return "\n".join([*parts, _table(("group", "commands, after `python -m benchmarks`"), commands)])


def _commands(group: str, found: list[dict[str, Any]]) -> list[str]:
    """Return the benchmarks that give rows of a group of the page, as one types them."""
    entries = [entry for entry in found if any(row[0] == group for row in rows_of(entry))]
    return sorted(f"`{entry['command'].removeprefix('python -m benchmarks ')}`" for entry in entries)


def _table(columns: Row, rows: Sequence[Row]) -> str:
    lines = [columns, ("---",) * len(columns), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/bench")))
