"""A clock that stands still is told from one that goes on, and from a process that was not served."""

from sphere_nav.ros.clocks import PATIENCE, ClockWatch

SECOND = 1_000_000_000
GIVE_UP = 5.0


def stand(watch, clock, begin, seconds):
    for k in range(int(seconds * 40) + 1):
        watch.observe(clock, begin + k * SECOND // 40)
    return begin + int(seconds * SECOND)


def test_a_clock_that_advances_is_not_standing():
    watch = ClockWatch(GIVE_UP)
    for k in range(1, 100):
        watch.observe(k * SECOND // 10, k * SECOND // 10)
        assert not watch.is_standing


def test_before_the_first_time_nothing_stands():
    watch = ClockWatch(GIVE_UP)
    stand(watch, 0, SECOND, 10.0)
    assert not watch.is_standing


def test_a_clock_that_stands_is_noticed_and_after_long_it_is_over():
    watch = ClockWatch(GIVE_UP)
    now = stand(watch, 5 * SECOND, SECOND, PATIENCE - 0.05)
    assert not watch.is_standing
    now = stand(watch, 5 * SECOND, now, 0.1)
    assert watch.is_standing
    assert not watch.is_over
    stand(watch, 5 * SECOND, now, GIVE_UP)
    assert watch.is_over


def test_a_clock_that_goes_on_was_a_pause_whatever_it_leaps():
    for leap in (SECOND // 10, SECOND):
        watch = ClockWatch(GIVE_UP)
        now = stand(watch, 5 * SECOND, SECOND, 2.0)
        assert watch.is_standing
        watch.observe(5 * SECOND + leap, now + 1)
        assert not watch.is_standing
        assert not watch.is_over


def test_a_process_that_was_not_served_did_not_see_the_clock_stand():
    watch = ClockWatch(GIVE_UP)
    for k in range(1, 4):  # three looks, 2 s apart, /clock in the queue each time
        watch.observe(5 * SECOND, 2 * k * SECOND)
    assert not watch.is_standing


def test_a_pause_begins_after_four_tenths_of_a_second_by_looks_of_a_tenth():
    watch = ClockWatch(give_up=2.0)
    watch.observe(5 * SECOND, SECOND)
    for k in range(1, 4):
        watch.observe(5 * SECOND, SECOND + k * SECOND)  # looks a second apart count a tenth each
    assert abs(watch.stood - 0.3) < 1e-9
    assert (watch.pause, watch.is_standing) == (0.0, False)
    watch.observe(5 * SECOND, 4 * SECOND + SECOND // 8)
    watch.observe(5 * SECOND, 4 * SECOND + SECOND // 8 + SECOND // 20)
    assert abs(watch.pause - 0.05) < 1e-9
    assert watch.is_standing


def test_it_is_over_after_its_time_but_never_before_it_is_a_pause():
    for give_up, end in ((2.0, 2.0), (0.1, 0.4)):
        watch = ClockWatch(give_up)
        now = stand(watch, 5 * SECOND, SECOND, end - 0.05)
        assert not watch.is_over
        stand(watch, 5 * SECOND, now, 0.1)
        assert watch.is_over
