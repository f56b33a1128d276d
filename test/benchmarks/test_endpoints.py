"""Lies to endpoints reach a node, a death by one of them is seen, and a short run kills no node."""

import importlib
import os
import signal
import time

import numpy as np
import pytest

pytest.importorskip("rclpy")

import rclpy
from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import State
from sensor_msgs.msg import Image
from std_msgs.msg import String

from benchmarks.abuse import endpoints
from benchmarks.abuse.endpoints import Interrogation, interrogate
from benchmarks.abuse.mutations import MARK, NO_UTF8, Liar, interface_class
from benchmarks.abuse.nodes import CASES, Case
from benchmarks.safety.fault_busy import front_of

FRAGILE = """
import os
from std_msgs.msg import String, UInt8
from sphere_nav.ros.node import ManagedNode
from sphere_nav.ros.run import run

class Fragile(ManagedNode):
    NAME = "fragile"

    def configure(self):
        self.add_subscription("text", String, self.on_text)
        self.add_subscription("number", UInt8, lambda message: 1 // (message.data // 200))

    def on_text(self, message):
        if len(message.data) > 40:
            os._exit(3)

def main():
    return run(Fragile)
"""


@pytest.mark.dds
def test_a_death_is_seen_and_told_and_the_node_starts_again(tmp_path, monkeypatch):
    (tmp_path / "fragile_node.py").write_text(FRAGILE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    case = Case(importlib.import_module("fragile_node").Fragile)
    (outcome,) = interrogate([(case, False)], 144, seed=3)
    assert outcome.num_lies >= 144
    assert 1 <= len(outcome.deaths) <= outcome.num_starts <= len(outcome.deaths) + 1
    assert all(death.startswith("fragile: ended with 3") for death in outcome.deaths)
    assert any(line.startswith("ZeroDivisionError") for line in outcome.mistakes)


GUARD = next(case for case in CASES if case.node_class.NAME == "command_guard")


@pytest.mark.dds
def test_lies_kill_no_node_and_the_end_of_a_front_and_the_silence_of_a_loop_are_seen(monkeypatch):
    monkeypatch.setattr(endpoints, "ANSWER", 3.0)
    monkeypatch.setattr(endpoints, "HEALTH", 1.5)
    one, examine, stopped = Interrogation._one, Interrogation._examine, []

    def lie_and_kill(self):
        if self.outcome.num_lies == 30:
            assert not self._victim.death
            os.kill(front_of(self._victim.process.pid), signal.SIGKILL)
        one(self)

    def stop_and_examine(self):
        if (
            self.outcome.num_lies > 100
            and not stopped
            and self._activate(endpoints.ANSWER) == State.PRIMARY_STATE_ACTIVE
        ):
            stopped.append(self._victim.process.pid)
            os.kill(stopped[0], signal.SIGSTOP)
            self._await_health(["nobody"], 0.0, 0.5)  # what it had told before
            time.sleep(endpoints.HEALTH)
        examine(self)

    monkeypatch.setattr(Interrogation, "_one", lie_and_kill)
    monkeypatch.setattr(Interrogation, "_examine", stop_and_examine)
    (outcome,) = interrogate([(GUARD, True)], 330, seed=4)
    assert ["ended with 1" in text for text in outcome.deaths] == [True]
    assert ["no diagnostics for 3 s" in text for text in outcome.silences] == [True]
    assert outcome.mistakes == {}
    assert outcome.counts["received"] > 20  # by the loop
    assert outcome.counts["refused"] > 0
    assert outcome.counts["failed"] > 0  # bytes that are no message, to either
    assert not rclpy.ok()


REQUESTS = [
    interface_class(name).Request
    for name in ("rcl_interfaces/srv/SetParameters", "sphere_nav_msgs/action/Navigate_SendGoal")
]


@pytest.mark.parametrize("kind", [Image, PoseStamped, *REQUESTS])
def test_lies_fill_every_field_with_all_sorts(kind):
    liar = Liar(np.random.default_rng(1))
    liar.words = ["gain"]
    texts = {repr(liar.message(kind)) for _ in range(100)}
    assert len(texts) > 50
    assert any("nan" in text or "255" in text for text in texts)


def test_bytes_that_are_no_text_or_too_few():
    liar = Liar(np.random.default_rng(2))
    found = [liar.raw(String(data=MARK)) for _ in range(60)]
    assert any(NO_UTF8 in data for data in found)
    assert len({len(data) for data in found}) > 3
