import time
from concurrent.futures import ThreadPoolExecutor

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


def test_what_fails_leaves_the_turn_to_others():
    background = BackgroundTurns(is_limited=True)
    for _ in range(2):
        try:
            with background.wait_for_turn():
                raise ValueError
        except ValueError:
            pass


def test_without_a_limit_all_work_at_once():
    background = BackgroundTurns(is_limited=False)
    with background.wait_for_turn(), background.wait_for_turn(is_urgent=True):
        pass
