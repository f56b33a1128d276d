"""A throttled log repeats a key only so often."""

from sphere_nav.ros.node import ThrottledLog


class Lines(list):
    def info(self, text):
        self.append(text)

    warning = error = info


def test_every_so_many_seconds():
    now, lines = [0.0], Lines()
    log = ThrottledLog(lines, clock=lambda: now[0])
    for second in range(25):
        now[0] = float(second)
        log.warning(f"waiting for {second} s", every=10.0, key="waiting")
        log.info("always")
    assert [line for line in lines if line != "always"] == ["waiting for 0 s", "waiting for 10 s", "waiting for 20 s"]
    assert lines.count("always") == 25


def test_without_a_key_the_text_is_the_key():
    lines = Lines()
    log = ThrottledLog(lines, clock=lambda: 0.0)
    for text in ("a", "b", "a"):
        log.error(text, every=1.0)
    assert lines == ["a", "b"]


def test_keys_that_do_not_come_again_are_forgotten():
    now, lines = [0.0], Lines()
    log = ThrottledLog(lines, clock=lambda: now[0])
    for number in range(10 * ThrottledLog.MAX_KEYS):
        now[0] = number * 0.01
        log.error(f"{number}: expected 1", every=60.0)
        log.error("in every turn", every=1.0)
    assert len(log._last) == ThrottledLog.MAX_KEYS
    assert len(lines) == 10 * ThrottledLog.MAX_KEYS + 20  # the one that comes again is held back as before
