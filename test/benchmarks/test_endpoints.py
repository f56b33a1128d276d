"""Lies to endpoints reach a node, a death by one of them is seen, and a short run kills no node."""

import importlib

import pytest

from benchmarks.abuse.endpoints import interrogate
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
