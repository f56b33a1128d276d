"""The page of faults names every fault of the list, tests that exist, and what one may rely on."""

import re
from pathlib import Path

from benchmarks.fault_list import FAULTS
from benchmarks.fault_page import promises

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "faults.md").read_text(encoding="utf-8")
HELD = re.findall(r"^\| (F\d+) +\| .* \| `(test/\S+\.py)` +\| `(\w+)`", PAGE, re.MULTILINE)
SOAK = {"F23"}  # is a bound: memory and files over hours of driving


def test_every_fault_has_a_drive_or_a_test():
    numbers = {number for fault in FAULTS for number in fault.number.split(", ")} | {row[0] for row in HELD} | SOAK
    assert numbers == {f"F{number}" for number in range(1, 27)}


def test_the_tests_that_are_named_exist():
    assert [row for row in HELD if f"def {row[2]}(" not in (ROOT / row[1]).read_text(encoding="utf-8")] == []


def test_what_takes_longer_than_usual_is_promised_apart():
    drives = {"tables": [{"rows": [("F3", "silent", "X", "0.6", "0.6", "0.7"), ("F26", "lags", "X", "2", "2", "2.8")]}]}
    rows = [("emergency stop", "", "0.3", "0.37"), ("SIGINT", "", "0.0", "0.02"), ("SIGTERM", "", "0.0", "0.01")]
    told = promises(drives, {"tables": [{"rows": rows}]}).splitlines()[2:]
    assert [line.split(" | ")[1].strip(" |") for line in told] == ["0.70 s", "2.8 s", "0.37 s", "0.02 s"]
