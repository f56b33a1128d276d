import time
from concurrent.futures import ThreadPoolExecutor

from dense_localizer.references.prefetch import Background


def test_one_works_at_a_time_and_the_urgent_one_is_next():
    background, order = Background(is_limited=True), list[str]()

    def work(name, is_urgent):
        with background.work(is_urgent=is_urgent):
            order.append(name)

    with ThreadPoolExecutor(2) as threads:
        with background.work():
            patient = threads.submit(work, "patient", False)
            urgent = threads.submit(work, "urgent", True)
            while not background._num_urgent:
                time.sleep(0.001)
            assert order == []
        patient.result(20.0)
        urgent.result(20.0)
    assert order == ["urgent", "patient"]


def test_what_fails_leaves_the_turn_to_others():
    background = Background(is_limited=True)
    for _ in range(2):
        try:
            with background.work():
                raise ValueError
        except ValueError:
            pass


def test_without_a_limit_all_work_at_once():
    background = Background(is_limited=False)
    with background.work(), background.work(is_urgent=True):
        pass
