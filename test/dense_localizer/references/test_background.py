import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from dense_localizer.references.prefetch import BackgroundTurns


def test_one_works_at_a_time_and_the_urgent_one_is_next():
    background, order = BackgroundTurns(is_limited=True), list[str]()

    def work(name, is_urgent):
        with background.wait_for_turn(is_urgent=is_urgent):
            order.append(name)

    with ThreadPoolExecutor(2) as threads:
        with background.wait_for_turn():
            patient = threads.submit(work, "patient", False)
            urgent = threads.submit(work, "urgent", True)
            while not background._num_urgent:
                time.sleep(0.001)
            assert order == []
        patient.result(20.0)
        urgent.result(20.0)
    assert order == ["urgent", "patient"]


def test_what_fails_leaves_the_turn_to_others_and_without_a_limit_all_work_at_once():
    background = BackgroundTurns(is_limited=True)
    with pytest.raises(ValueError, match="failed"), background.wait_for_turn():
        raise ValueError("failed")
    with ThreadPoolExecutor(1) as threads:
        assert threads.submit(take_turn, background).result(20.0) == "worked"
    background = BackgroundTurns(is_limited=False)
    with ThreadPoolExecutor(1) as threads, background.wait_for_turn():
        assert threads.submit(take_turn, background).result(20.0) == "worked"


def take_turn(background):
    with background.wait_for_turn(is_urgent=True):
        return "worked"
