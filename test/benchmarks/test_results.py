"""docs/results.md: headlines alone, RED first, few; it is what the suite writes."""

from benchmarks.report import Bound, Headline, Report
from benchmarks.results import COLUMNS, MAX_ROWS, PAGE, rows_of, write_page


def entry(name, *bounds):
    head = {"group": "drive", "name": name, "command": f"python -m benchmarks drive {name} --seed N", "seed": 7}
    head |= {"size": "quick", "machine": "a box, 2 cores; python 3.11", "commit": "abc"}
    return head | Report(name, bounds=list(bounds)).as_mapping()


def bound(what, measured, group="map"):
    return Bound(what, 1.0, measured, "m", headline=Headline(group, "a town"))


def marks(page):
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in page.splitlines()]
    return [(row[1], row[COLUMNS.index("mark")]) for row in rows if len(row) == len(COLUMNS)][2:]


def test_the_page_is_short_and_red_comes_first():
    found = [mark for _, mark in marks(PAGE.read_text(encoding="utf-8"))]
    assert len(found) <= MAX_ROWS
    assert found == sorted(found)


def test_a_headline_is_a_row_and_another_bound_is_none():
    found = entry("map", bound("drift", 2.0), Bound("detail", 1.0, 3.0, "m"))
    row = ("map", "drift", "2 m", "≤ 1 m", "RED", "—", "a town, quick, 7", "abc", found["date"])
    assert rows_of(found) == [row]


def test_what_is_red_or_unmeasured_comes_first_then_group_by_group():
    page = write_page([entry("a", bound("late", 0.5, "robustness"), bound("drift", 0.5)), entry("b", bound("x", 2.0))])
    assert marks(page) == [("x", "RED"), ("drift", "ok"), ("late", "ok")]
    assert "| map | `drive a --seed N`, `drive b --seed N` |" in page
    assert marks(write_page([entry("a", bound("lost", float("nan")))])) == [("lost", "RED")]
