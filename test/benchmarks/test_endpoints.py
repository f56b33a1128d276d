"""Lies to endpoints reach a node, a death by one of them is seen, and a short run kills no node."""

import importlib

import numpy as np
import pytest

pytest.importorskip("rclpy")

from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import Image
from std_msgs.msg import String

from benchmarks.abuse.endpoints import interrogate
from benchmarks.abuse.mutations import MARK, NO_UTF8, Liar, interface_class
from benchmarks.abuse.nodes import Case

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
