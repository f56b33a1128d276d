"""Pages name what exists: files, benchmarks and commands; and every numbered item of the papers has its row."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

from architecture.tree import EXECUTABLES, PACKAGES, ROOT
from benchmarks.__main__ import BENCHMARKS
from sphere_nav.cli.main import COMMANDS

PAGES = ("README.md", "docs/architecture.md", "docs/conventions.md", "docs/papers.md")
NUMBERED = {"M15": {"eq": 35, "alg": 1, "fig": 20}, "N17": {"eq": 2, "alg": 2, "fig": 8}}
TABLES = {"M15": "tab. 1", "N17": "tab. I"}
ELSEWHERE = {"ros/", "out/demo/", "redkitchen/"}  # a kind of folder, and what commands make or read
FIGURE = {6: 4, 4: 2}  # column of the figure reached, by the number of columns of a table


def text_of(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def rows(page: str) -> Iterator[list[str]]:
    """Yield the cells of every row of the tables of a page."""
    for line in text_of(page).splitlines():
        if line.startswith("| "):
            yield [cell.strip() for cell in line.strip("|").split(" | ")]


@pytest.mark.parametrize("page", PAGES)
def test_named_files_exist(page):
    """A path starts at the root or at `test/`; in architecture.md also at the package that the paragraph is about."""
    folders = [ROOT, ROOT / "test"]
    if page == "docs/architecture.md":
        folders += [path.parent for name in PACKAGES for path in (ROOT / name).rglob("__init__.py")]
    named = set(re.findall(r"`([\w./]+\.(?:py|msg|md)|[\w./]+/)`", text_of(page))) - ELSEWHERE
    assert [name for name in sorted(named) if not any((at / name).exists() for at in folders)] == []


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page):
    targets = re.findall(r"\]\(([^)#:]+)\)", text_of(page))
    assert [target for target in targets if not ((ROOT / page).parent / target).exists()] == []


@pytest.mark.parametrize("paper", NUMBERED)
def test_every_numbered_item_of_a_paper_has_a_row(paper):
    m15, n17 = text_of("docs/papers.md").split("\n## N17", 1)
    first = re.findall(r"^\| ([^|]*) \|", {"M15": m15, "N17": n17}[paper], re.MULTILINE)
    for kind, count in NUMBERED[paper].items():
        found = {int(number) for cell in first for number in re.findall(rf"{kind}\. (\d+)", cell)}
        assert found == set(range(1, count + 1)), kind
    assert TABLES[paper] in first


def test_named_benchmarks_and_commands_exist():
    known = {command.name for command in COMMANDS}
    for cells in rows("docs/papers.md"):
        for words in (call.split() for call in re.findall(r"`([^`/]+)`", cells[FIGURE[len(cells)]])):
            assert words[0] in BENCHMARKS or (words[0] == "sphere_nav" and words[1] in known), cells[0]


def test_the_commands_of_the_readme_exist():
    text = text_of("README.md")
    known = {command.name for command in COMMANDS}
    named = set(
        re.findall(r"sphere_nav (?!sphere_nav)([a-z][\w-]*) ", "\n".join(re.findall(r"```\n(.*?)```", text, re.DOTALL)))
    )
    assert named - known - {"navigation"} == set()
    targets = set(re.findall(r"^\.PHONY: (.*)$", text_of("Makefile"), re.MULTILINE)[0].split())
    assert set(re.findall(r"(?:^|`)make ([a-z-]+)", text, re.MULTILINE)) - targets == set()
    assert set(re.findall(r"\.venv/bin/(\w+)", text)) - set(EXECUTABLES) == set()
