"""`python -m benchmarks.results [FOLDER]`: docs/results.md from the JSON files of the benchmarks (`make bench-report`).

The rows of a benchmark that was measured replace those that the page has of it; the others stay with their date.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

PAGE = Path(__file__).resolve().parents[1] / "docs" / "results.md"
COLUMNS = ("what", "bound", "measured", "mark", "command", "machine", "date")
INTRODUCTION = """\
# Results

Written by `make bench-report` from `out/bench/*.json`, which `make bench` leaves; why a figure is as it is stands on
docs/notes/. RED: the bound is not met. Recordings are read from `../shared/data`. Redkitchen is judged by
COLMAP's poses, right to about 5 mm and 0.2°; its recorded ones are wrong
([why](notes/ground_truth.md)).
"""

Row = tuple[str, ...]


def main(folder: Path) -> int:
    """Write the page anew."""
    kept = read_page(PAGE.read_text(encoding="utf-8"))
    found = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("*.json"))]
    PAGE.write_text(write_page(merge(kept, found)), encoding="utf-8")
    return 0


def read_page(text: str) -> list[Row]:
    """Return the rows of the table on a page; ValueError where a row has another number of cells."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    rows = [tuple(cell.strip() for cell in line.strip("|").split("|")) for line in lines[2:]]
    if wrong := [row for row in rows if len(row) != len(COLUMNS)]:
        raise ValueError(f"{PAGE.name}: expected {len(COLUMNS)} cells in a row, found {len(wrong[0])}: {wrong[0]}")
    return rows


def merge(kept: list[Row], found: list[dict[str, Any]]) -> list[Row]:
    """Return the rows with those of the benchmarks that were measured now in the place of their old ones."""
    measured = {entry["name"]: rows_of(entry) for entry in found if entry["rows"]}
    merged: list[Row] = []
    for row in kept:
        name = benchmark_of(row)
        if name not in measured:
            merged.append(row)
        elif measured[name]:
            merged += measured[name]
            measured[name] = []
    return merged + [row for rows in measured.values() for row in rows]


def rows_of(entry: dict[str, Any]) -> list[Row]:
    """Return the rows of one benchmark's JSON."""
    machine = entry["machine"].split(";")[0]
    found = [entry | row | {"machine": machine, "command": f"`{row['command']}`"} for row in entry["rows"]]
    return [tuple(str(row[name]) for name in COLUMNS) for row in found]


def benchmark_of(row: Row) -> str:
    """Return the name of the benchmark that measured a row: the first word of its command after the module."""
    words = row[COLUMNS.index("command")].strip("`").split()
    return words[3] if words[:3] == ["python", "-m", "benchmarks"] else " ".join(words)


def write_page(rows: list[Row]) -> str:
    """Return the page."""
    lines = [COLUMNS, ("---",) * len(COLUMNS), *rows]
    return INTRODUCTION + "\n" + "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/bench")))
