"""Whatever a handler raises, the caller gets one line and the node goes on."""

from std_srvs.srv import Empty, Trigger

from sphere_nav.ros.node import ThrottledLog
from sphere_nav.ros.service import answer_always, one_line


class Failures(list):
    def error(self, text, *, every, key):
        self.append((text, key))


def failing(error):
    def handler(request, response):
        response.success, response.message = True, "half done"
        raise error

    return handler


def test_every_exception_is_an_answer():
    for error, line, is_ours in [
        (ValueError("map: expected a,\nfound b"), "map: expected a, found b", False),
        (FileNotFoundError(2, "No such file or directory", "/x"), "/x: No such file or directory", False),
        (KeyError("a"), "KeyError: 'a'", True),
        (MemoryError(), "MemoryError", True),
    ]:
        log = Failures()
        answer = answer_always(failing(error), "load", log)
        found = answer(Trigger.Request(), Trigger.Response())
        assert (found.success, found.message) == (False, line)
        ((text, key),) = log
        assert ("Traceback" in text) == is_ours
        assert text.startswith("load: ")
        assert key == f"service load: {type(error).__name__}"


def test_an_answer_passes_and_a_response_without_success_is_empty():
    def handler(request, response):
        raise ValueError("no")

    assert answer_always(handler, "x", Failures())(Empty.Request(), Empty.Response()) == Empty.Response()

    def works(request, response):
        response.success = True
        return response

    assert answer_always(works, "x", None)(Trigger.Request(), Trigger.Response()).success


def test_a_line_is_short_whatever_was_found():
    text = one_line(ValueError("x.yaml: expected a number, found " + "x" * 100_000 + ", see the docs"))
    assert len(text) < 1000
    assert text.startswith("x.yaml: expected a number, found xx")
    assert text.endswith("see the docs")


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
