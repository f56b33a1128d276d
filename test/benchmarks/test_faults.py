"""The table of faults names every fault of the list, and tests that exist."""

from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from benchmarks.fault_list import FAULTS
from benchmarks.safety.faults import HELD

ROOT = Path(__file__).parents[2]
SOAK = {"F23"}  # is a bound: memory and files over hours of driving


def test_every_fault_has_a_drive_or_a_test():
    numbers = {number for fault in FAULTS for number in fault.number.split(", ")} | {row[0] for row in HELD} | SOAK
    assert numbers == {f"F{number}" for number in range(1, 27)}


@pytest.mark.parametrize(("file", "name"), [row[2:] for row in HELD])
def test_the_tests_that_are_named_exist(file, name):
    text = (ROOT / file).read_text(encoding="utf-8")
    assert f"def {name}(" in text if name else "def test" in text
