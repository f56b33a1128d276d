"""Whole lifecycles of every node over DDS: configure, activate, work, deactivate, clean up.

After each the node must work again, and nothing may be left behind: no entity of the middleware, no open file.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn

from benchmarks.lifecycle_cases import CASES, Bench
from benchmarks.machine import describe
from benchmarks.report import Bound, Report, Table

HELP = "100 whole lifecycles of every node: it works after each, and nothing is left behind"
CYCLES, QUICK_CYCLES = 100, 5
SETTLED = 10  # what libraries allocate once is there after as many
DOMAIN = "47"


@dataclass
class Lives:
    """What was counted at the end of each lifecycle."""

    num_failed: int = 0  # transitions that failed, or a node that did not work
    entities: list[int] = field(default_factory=list)
    handles: list[int] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def left_entities(self) -> int:
        """Entities of the last lifecycle more than of the first."""
        return max(self.entities) - self.entities[0]

    @property
    def left_handles(self) -> int:
        """Open files at most more than when the libraries had theirs."""
        settled = min(SETTLED, len(self.handles) // 2)
        return max(self.handles[settled:]) - self.handles[settled]


def live(bench: Bench, num_cycles: int, every: int = 1) -> Lives:
    """Live through whole lifecycles; in every so many, and in the last, the node must work."""
    lives, started = Lives(), time.perf_counter()
    shell = bench.shell
    for cycle in range(num_cycles):
        bench.renew()
        steps = [shell.trigger_configure(), shell.trigger_activate()]
        if cycle % every == 0 or cycle == num_cycles - 1:
            lives.num_failed += not bench.works()
        steps += [shell.trigger_deactivate(), shell.trigger_cleanup()]
        lives.num_failed += sum(step != TransitionCallbackReturn.SUCCESS for step in steps)
        bench.executor.spin_once(timeout_sec=0.0)
        lives.handles.append(len(os.listdir("/proc/self/fd")))
        lives.entities.append(
            sum(len(list(items)) for items in (shell.subscriptions, shell.publishers, shell.services, shell.timers))
        )
    lives.seconds = time.perf_counter() - started
    return lives


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Add the number of lifecycles."""
    parser.add_argument("--cycles", type=int, default=CYCLES, help=f"lifecycles of each node (default {CYCLES})")


def run(options: argparse.Namespace) -> Report:
    """Live through the lifecycles of every node."""
    os.environ["ROS_DOMAIN_ID"] = DOMAIN
    num_cycles, rows, report = QUICK_CYCLES if options.quick else options.cycles, [], Report("lifecycle")
    report.notes += [describe(options.threads), __doc__ or ""]
    found: list[Lives] = []
    for case in CASES:
        rclpy.init()
        executor = SingleThreadedExecutor()
        with tempfile.TemporaryDirectory() as folder:
            bench = Bench(executor, case, Path(folder))
            lives = live(bench, num_cycles)
            bench.close()
        executor.shutdown()
        rclpy.shutdown()
        found.append(lives)
        counts = (num_cycles, lives.num_failed, lives.left_entities, lives.left_handles, round(lives.seconds, 1))
        rows.append((case.node_class.NAME, *map(str, counts)))
    columns = ("node", "lifecycles", "failed", "entities left", "open files left", "seconds")
    report.tables.append(Table(f"{num_cycles} lifecycles of each node, working in each", columns, rows))
    report.bounds += _bounds(found)
    return report


def _bounds(found: Sequence[Lives]) -> list[Bound]:
    return [
        Bound("lifecycles that failed, of all nodes", 0, sum(lives.num_failed for lives in found), ""),
        Bound("entities left by a node", 0, max(lives.left_entities for lives in found), ""),
        Bound("open files left by a node (one: a discovery of that moment)", 1,
              max(lives.left_handles for lives in found), ""),
    ]  # fmt: skip
