"""Pages name what exists: files, tests, links, benchmarks; and every numbered item of the papers has its row."""

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from architecture.tree import EXECUTABLES, PACKAGES, ROOT, for_all
from sphere_nav_tools.cli.main import COMMANDS

pytestmark = pytest.mark.slow  # of the checks: `make check`

PAGES = sorted(str(page.relative_to(ROOT)) for page in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
EXACT = {"README.md", "docs/conventions.md", "docs/papers.md"}  # paths from the root; elsewhere of what a page is about
NUMBERED = {"M15": {"eq": 35, "alg": 1, "fig": 20}, "N17": {"eq": 2, "alg": 2, "fig": 8}}
TABLES = {"M15": "tab. 1", "N17": "tab. I"}
ELSEWHERE = {"ros/", "out/demo/", "redkitchen/"}  # a kind of folder, and what commands make or read
OTHERS = {"msg_defs", "test", "benchmarks", "scripts", "docs"}
OTHERS |= {"config", "launch", "cmake", "rosdep", "bags", "examples"}
TREES = (*PACKAGES, *OTHERS)
MAX_LINES = {"docs": 120, "README.md": 120, "CHANGELOG.md": 60}  # of a page for users
MAX_WORDS = 40  # of a sentence on such a page
LONG = {"docs/papers.md", "docs/results.md", "docs/parameters.md", "docs/faults.md"}
FIGURE = {5: 3, 4: 2}  # column of the figure reached, by the number of columns of a table
NOTES = [page for page in PAGES if page.startswith("docs/notes/") and page != "docs/notes/README.md"]
MAX_NOTES = 25  # with their index
MAX_LINES_OF_A_NOTE = 40
PARTS_OF_A_NOTE = ("**Question.**", "**Rule", "**Limits", "**Figure", "**Where.**")
GONE = {"docs/notes/tried_and_not_kept.md"}  # its code is gone, so that it has no place
MAX_WORDS_OF_ALL = 43_000  # README and docs/ without results.md; with it 45,000


def text_of(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def rows(page: str) -> Iterator[list[str]]:
    for line in text_of(page).splitlines():
        if line.startswith("| "):
            yield [cell.strip() for cell in line.strip("|").split(" | ")]


@cache
def files() -> set[str]:
    """Return the files of the checkout, and their folders with a slash at the end, below the root."""
    found = {str(path.relative_to(ROOT)) for path in ROOT.iterdir() if path.is_file()}
    for path in (path for tree in TREES for path in [ROOT / tree, *(ROOT / tree).rglob("*")]):
        found.add(f"{path.relative_to(ROOT)}{'/' if path.is_dir() else ''}")
    return found


@cache
def ends() -> set[str]:
    """Return what a page may call a file or folder by: its path, or the end of it."""
    parts = [(path, path.strip("/").split("/")) for path in files()]
    return {"/".join(words[at:]) + path[len(path.rstrip("/")) :] for path, words in parts for at in range(len(words))}


@for_all(PAGES)
def test_named_files_exist(page):
    """A path starts at the root or at `test/`; on other pages it may be the end of one: they name a folder before."""
    text = re.sub(r"`([^`\n]*)\n([^`\n]*)`", r"`\1\2`", text_of(page))
    named = set(re.findall(r"`([\w./]+\.(?:py|msg|srv|action|md|sh)|[\w./]+/)`", text)) - ELSEWHERE
    known = files() | {f.removeprefix("test/") for f in files()} if page in EXACT else ends()
    assert [name for name in sorted(named) if name not in known] == []


@cache
def names_of_tests() -> set[str]:
    """Return the names of all modules and functions of tests."""
    modules = list((ROOT / "test").rglob("test_*.py"))
    named = (re.findall(r"^ *def (test_\w+)\(", path.read_text(encoding="utf-8"), re.MULTILINE) for path in modules)
    return {path.stem for path in modules}.union(*named)


@for_all(PAGES)
def test_named_tests_exist(page):
    named = set(re.findall(r"`(test_\w+)`", text_of(page)))
    assert sorted(named - names_of_tests()) == []


@for_all(PAGES)
def test_links_lead_somewhere(page):
    """A link names a file that exists, and behind `#` one of its headings."""
    targets = re.findall(r"\]\(([^)\s]+)\)", text_of(page))
    wrong = []
    for target in (target for target in targets if "://" not in target):
        name, _, heading = target.partition("#")
        file = (ROOT / page).parent / name if name else ROOT / page
        if not file.exists() or (heading and heading not in headings(file)):
            wrong.append(target)
    assert wrong == []


def headings(page: Path) -> set[str]:
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    lines = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", line.strip().lower()).replace(" ", "-") for line in lines}


@for_all(PAGES)
def test_pages_for_users_are_short(page):
    limit = MAX_LINES.get(str(Path(page).parent), MAX_LINES.get(page))
    if limit and page not in LONG:
        assert len(text_of(page).splitlines()) <= limit


@for_all(NUMBERED)
def test_every_numbered_item_of_a_paper_has_a_row(paper):
    m15, n17 = text_of("docs/papers.md").split("\n## N17", 1)
    first = re.findall(r"^\| ([^|]*) \|", {"M15": m15, "N17": n17}[paper], re.MULTILINE)
    for kind, count in NUMBERED[paper].items():
        found = {int(number) for cell in first for number in re.findall(rf"{kind}\. (\d+)", cell)}
        assert found == set(range(1, count + 1)), kind
    assert TABLES[paper] in first


def test_named_benchmarks_and_commands_exist():
    known = set(COMMANDS)
    stems = {path.stem for path in (ROOT / "benchmarks").rglob("*.py")}
    for cells in rows("docs/papers.md"):
        for words in (call.split() for call in re.findall(r"`([^`/]+)`", cells[FIGURE[len(cells)]])):
            assert any(words[0] in stem for stem in stems) or words[1] in known, cells[0]


def test_the_readme_names_targets_and_executables_that_are_there():
    text = text_of("README.md")
    targets = set(re.findall(r"^\.PHONY: (.*)$", text_of("Makefile"), re.MULTILINE)[0].split())
    assert set(re.findall(r"(?:^|`)make ([a-z-]+)", text, re.MULTILINE)) - targets == set()
    assert set(re.findall(r"\.venv/bin/(\w+)", text)) - set(EXECUTABLES) == set()


def test_no_topic_of_a_map_is_told_that_is_not_written():
    code = text_of("sphere_nav/ros/maps/writer.py")
    told = set(re.findall(r"`(/map/\w+)`", text_of("docs/architecture.md")))
    assert told == set(re.findall(r'"(/map/\w+)"', code)) != set()


def test_a_note_has_its_parts_on_one_page():
    """Question, rule, limits, figure and place of each, on 40 lines; what is wrong, in one list."""
    texts = {note: text_of(note) for note in NOTES}
    missing = [f"{n}: {part}" for n, text in texts.items() for part in PARTS_OF_A_NOTE if part not in text]
    assert [line for line in missing if line not in {f"{note}: **Where.**" for note in GONE}] == []
    assert [note for note, text in texts.items() if len(text.splitlines()) > MAX_LINES_OF_A_NOTE] == []
    assert len(NOTES) + 1 <= MAX_NOTES
    assert set(re.findall(r"\]\((\w+\.md)\)", text_of("docs/notes/README.md"))) == {Path(n).name for n in NOTES}


def test_all_pages_can_be_read():
    words = {page: len(text_of(page).split()) for page in PAGES if page.startswith(("docs/", "README"))}
    assert sum(words.values()) - words["docs/results.md"] <= MAX_WORDS_OF_ALL


@for_all(PAGES)
def test_sentences_of_pages_for_users_are_short(page):
    if str(Path(page).parent) not in ("docs", ".") or page in LONG:
        return
    text = re.sub(r"^```.*?^```|^\|.*?$|^#.*?$|^ {4}.*?$", "", text_of(page), flags=re.DOTALL | re.MULTILINE)
    pieces = re.split(r"\n\s*\n|\n(?=\s*(?:[-*]|\d\.) )", text)
    sentences = [one for piece in pieces for one in re.split(r"(?<=[.!?:])\s+(?=[A-Z*`\[])", " ".join(piece.split()))]
    assert [one for one in sentences if len(one.split()) > MAX_WORDS] == []
