"""The fuzzer sees crashes, hangs and gigabytes; a short run over everything finds none."""

import ctypes
import faulthandler
import time

import numpy as np
import pytest

from benchmarks.abuse import fuzz
from benchmarks.abuse.fuzz import Target, make_targets


def failures(attempt, folder, count=20):
    (outcome,) = fuzz.fuzz([Target("sample", attempt)], folder, 1, count)
    assert outcome.num_inputs == count
    return outcome


@pytest.mark.dds
def test_what_goes_wrong_is_told_with_its_input(tmp_path, monkeypatch):
    monkeypatch.setattr(fuzz, "SECONDS", 1.0)
    monkeypatch.setattr(fuzz, "PATIENCE", 2)

    def attempt(rng, folder):
        match int(rng.integers(40)):
            case 0:
                faulthandler.disable()  # this one is meant
                ctypes.string_at(0)
            case 1:
                time.sleep(4)
            case 2:
                np.ones(1 << 29)
            case 3:
                raise KeyError("oops")
            case 4:
                raise ValueError("two\nlines")
            case n if n < 20:
                raise ValueError("refused")

    found = failures(attempt, tmp_path, 200)
    text = "\n".join(found.failures)
    for expected in ("SIGSEGV", "no end after", "MemoryError", "KeyError at test_fuzz.py", "expected one line"):
        assert expected in text
    assert found.num_accepted + found.num_refused > 100
    again = failures(attempt, tmp_path, 200)
    assert again.failures == found.failures  # the same seed, the same inputs


@pytest.mark.dds
def test_a_short_run_over_everything(tmp_path):
    outcomes = fuzz.fuzz(make_targets(tmp_path), tmp_path, seed=11, count=800)
    assert len(outcomes) > 25
    assert [failure for outcome in outcomes for failure in outcome.failures] == []
    assert sum(outcome.num_refused for outcome in outcomes) > 300
    assert sum(outcome.num_accepted for outcome in outcomes) > 100
