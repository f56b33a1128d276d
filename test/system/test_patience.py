"""A node that gets no processor has not been slow; one that does nothing has."""

import subprocess
import sys
import time

import pytest

from worlds.patience import Patience, ran_and_waited, wait_until

BUSY = [sys.executable, "-c", "while True: pass"]


def test_waiting_for_what_does_nothing_ends_in_time():
    began = time.monotonic()
    assert not wait_until(lambda: False, 0.5)
    assert wait_until(lambda: True, 0.0)
    assert time.monotonic() - began >= 0.5


def test_a_machine_without_time_for_us_is_no_loss_of_patience(monkeypatch):
    threads, now = {"a": (0, 0)}, [0.0]
    monkeypatch.setattr("worlds.patience.ran_and_waited", lambda: dict(threads))
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    patience = Patience(30.0)
    for second in range(1, 201):  # a tenth of the processor is ours
        now[0] = float(second)
        threads["a"] = (10**8 * second, 9 * 10**8 * second)
        assert patience.is_left()
    threads["b"] = (0, 0)
    for second in range(201, 210):  # nobody of us wants it
        now[0] = float(second)
        assert patience.is_left()
    now[0] = 211.0
    assert not patience.is_left()


@pytest.mark.dds
def test_a_process_of_ours_that_works_is_seen():
    with subprocess.Popen(BUSY) as child:
        seen = wait_until(
            lambda: any(str(child.pid) in path.parts and ran for path, (ran, _) in ran_and_waited().items())
        )
        child.kill()
    assert seen
