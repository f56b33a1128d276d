"""docs/results.md: its table is read, rows of a benchmark replace its old ones, every figure has a mark."""

import pytest

from benchmarks.report import Bound, Report
from benchmarks.results import COLUMNS, PAGE, merge, read_page, rows_of, write_page

OLD = [
    ("speed", "≤ 1 ms", "2 ms", "RED", "`python -m benchmarks fast`", "a desk", "2026-01-01"),
    ("size", "≤ 1 MB", "1 MB", "ok", "`python -m benchmarks small --quick`", "a desk", "2026-01-01"),
    ("drive", "≤ 1 m", "0 m", "ok", "`sphere_nav demo`", "a desk", "2026-01-01"),
]


def entry(name, *bounds):
    return Report(name, bounds=list(bounds)).as_mapping(f"python -m benchmarks {name}", "a box, 2 cores; python 3.11")


def test_the_page_is_one_table_with_a_mark_in_every_row():
    text = PAGE.read_text(encoding="utf-8")
    rows = read_page(text)
    figures = [(row[COLUMNS.index("what")], row[COLUMNS.index("command")]) for row in rows]
    assert len(set(figures)) == len(figures), "a figure that stands on the page twice"
    assert {row[COLUMNS.index("mark")] for row in rows} == {"ok", "RED"}
    assert write_page(rows) == text


def test_what_was_measured_now_replaces_what_was_measured_before():
    fast = entry("fast", Bound("speed", 1.0, 0.5, "ms"), Bound("speed, p99", 1.0, float("nan"), "ms"))
    rows = merge(OLD, [fast, entry("new", Bound("share", 0.9, 0.95, "", is_minimum=True)), entry("empty")])
    assert [row[0] for row in rows] == ["speed", "speed, p99", "size", "drive", "share"]
    assert rows[0][1:6] == ("≤ 1 ms", "0.5 ms", "ok", "`python -m benchmarks fast`", "a box, 2 cores")
    assert [row[3] for row in rows] == ["ok", "RED", "ok", "ok", "ok"]  # what could not be measured is not met
    assert rows_of(fast)[0] == rows[0]


def test_a_row_that_is_cut_is_refused():
    with pytest.raises(ValueError, match="expected 7 cells in a row, found 3"):
        read_page("| " + " | ".join(COLUMNS) + " |\n|---|\n| a | b | c |\n")
