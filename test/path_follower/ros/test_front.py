"""What goes over between a front and its loop: answers in order, refusals, silence, and the end."""

import os
import threading
from multiprocessing import Pipe

import pytest

from path_follower.ros import front
from path_follower.ros.front import LOOP, LoopEnded, RemoteLoop, connected


@pytest.fixture
def pair():
    ours, theirs = Pipe()
    yield RemoteLoop(ours), theirs
    theirs.close()


def serve(theirs, *answers):
    """Answer a request after the other; an answer has a number in place of the request's where it says one."""

    def run():
        for answer in answers:
            number, _, _ = theirs.recv()
            theirs.send(answer if len(answer) == 3 else (number, *answer))

    threading.Thread(target=run, daemon=True).start()


def test_a_request_is_answered(pair):
    loop, theirs = pair
    serve(theirs, (True, 5), (False, "path: expected a follower that stands"))
    assert loop.ask("is_at_rest") == 5
    with pytest.raises(ValueError, match="expected a follower that stands"):
        loop.ask("load", "path")


def test_an_answer_that_comes_late_is_not_taken_for_the_next(pair, monkeypatch):
    monkeypatch.setattr(front, "PATIENCE", 0.05)
    loop, theirs = pair
    with pytest.raises(ValueError, match=r"start: no answer of the control loop for 0\.05 s"):
        loop.ask("start")
    number, name, _ = theirs.recv()
    assert name == "start"
    theirs.send((number, True, "late"))
    serve(theirs, (True, "in time"))
    monkeypatch.setattr(front, "PATIENCE", 5.0)
    assert loop.ask("stop") == "in time"


def test_a_loop_that_has_ended_is_told(pair):
    loop, theirs = pair
    theirs.close()
    with pytest.raises(LoopEnded, match="start: the control loop has ended"):
        loop.ask("start")


def test_a_process_that_nobody_started_has_no_loop(monkeypatch):
    monkeypatch.delenv(LOOP, raising=False)
    assert connected() is None


def test_a_front_ends_with_its_loop(monkeypatch):
    """The descriptor that nobody writes tells the end."""
    told = threading.Event()
    monkeypatch.setattr(front.os, "kill", lambda pid, number: told.set())
    life, watched = os.pipe()
    ours, theirs = Pipe()
    monkeypatch.setenv(LOOP, f"{os.dup(ours.fileno())} {life}")
    assert connected() is not None
    assert LOOP not in os.environ
    assert not told.wait(0.05)
    os.close(watched)
    assert told.wait(5.0)
    theirs.close()
