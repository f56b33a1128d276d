"""The rings of tests, by what a test costs: what is above the limit of its ring fails.

CPU time counts, of this process and of those that it has waited for, and by what a loop takes beside it: neither other
work on the machine nor a slow machine makes a test fail.
"""

from __future__ import annotations

import re
import resource
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

FAST_S, SLOW_S = 0.3, 20.0  # CPU time on the computer of `LOOP_S`
SHARED_S = 1.0  # what several tests of the first ring share: a town
MARGIN = 4.0  # kernels that a process loads first, garbage that it collects
LOOP_S = 0.02  # CPU time of `loop` on a quiet core
HANGS_S = {False: 120.0, True: 600.0}  # wall time after which a test of the first ring, or of another, hangs
FIRST, OTHERS = "not slow and not dds", "slow or dds"  # what `make test` and `make test-slow` select
LONGEST = ("mapping/test_extension", "maps/test_map_learn", "system/test_chain", "mapping/test_killed")  # measured
OF_A_FILE = re.compile(r"^pytestmark = .*\bpytest\.mark\.(slow|dds)\b", re.MULTILINE)
OF_A_TEST = re.compile(r"\bpytest\.mark\.(slow|dds)\b")
STARTED = pytest.StashKey[float]()


def cpu_seconds() -> float:
    """Return the CPU time of this process and of the children that have ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def loop() -> float:
    """Return the CPU time that some work takes, s."""
    begun = time.process_time()
    sum(number * number for number in range(300_000))
    return time.process_time() - begun


def is_outer(item: pytest.Item) -> bool:
    """Whether a test is of another ring than the first."""
    return any(item.get_closest_marker(name) for name in ("slow", "dds"))


def rank(path: Path, with_processes: set[Path]) -> int:
    """Return when the tests of a file begin: first the longest files, then those that start processes."""
    found = [number for number, end in enumerate(LONGEST) if path.as_posix().endswith(f"/{end}.py")]
    return found[0] if found else len(LONGEST) + (path not in with_processes)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Load no file whose tests are all of another ring: what they import takes seconds."""
    if collection_path.suffix != ".py" or config.option.markexpr not in (FIRST, OTHERS):
        return None
    text = collection_path.read_text(encoding="utf-8")
    is_other = OF_A_FILE.search(text) if config.option.markexpr == FIRST else not OF_A_TEST.search(text)
    return True if is_other else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with what takes longest; end a test that hangs: the process ends, and says where each thread is."""
    with_processes = {item.path for item in items if item.get_closest_marker("dds")}
    items.sort(key=lambda item: rank(item.path, with_processes))
    for item in items:
        if item.get_closest_marker("timeout") is None:
            item.add_marker(pytest.mark.timeout(HANGS_S[is_outer(item)], method="thread"))


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> Iterator[None]:
    """See what the fixtures of a test cost, too."""
    item.stash[STARTED] = cpu_seconds()
    return (yield)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_fixture_setup(fixturedef: pytest.FixtureDef[object], request: pytest.FixtureRequest) -> Iterator[None]:
    """Charge what several tests share to none of them: which comes first is chance."""
    begun = cpu_seconds()
    result = yield
    item = request._pyfuncitem
    if fixturedef.scope != "function":
        item.stash[STARTED] = item.stash.get(STARTED, begun) + cpu_seconds() - begun
        if told := excess(cpu_seconds() - begun, SLOW_S if is_outer(item) else SHARED_S):
            pytest.fail(f"{fixturedef.argname}: {told}", pytrace=False)
    return result


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Fail a test above the limit of its ring."""
    result = yield
    if told := excess(cpu_seconds() - item.stash[STARTED], SLOW_S if is_outer(item) else FAST_S):
        pytest.fail(told, pytrace=False)
    return result


def excess(seconds: float, allowed: float) -> str:
    """Return what is told of a test that took so much CPU time; empty where that is within what its ring allows."""
    limit = MARGIN * allowed
    if seconds <= limit:
        return ""
    seconds /= max(loop() / LOOP_S, 1.0)
    advice = "make it smaller, or mark it `slow`"
    return f"expected at most {limit:g} s of CPU, found {seconds:.1f} s: {advice}" if seconds > limit else ""
