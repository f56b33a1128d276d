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
