"""Lies to every endpoint of every node: topics, its services, and those that rclpy makes. No process may die of them.

Each node is what its command starts, over DDS, once on the time of the system and once on /clock: a process, or a
control loop with its front. After every few lies it has to answer a question, and to have told its health lately, the
loop as well as the front; a node that was deactivated is activated again, one that was shut down starts anew.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import chdir, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import ListParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.task import Future

from benchmarks.abuse.mutations import Liar, interface_class, mutate_message
from benchmarks.abuse.nodes import CASES, Case
from benchmarks.report import Bound, Headline, Report, Table
from benchmarks.safety.fault_busy import front_of
from path_follower.ros.front import FrontNode
from sphere_nav.ros import qos
from sphere_nav_tools.cli.processes import NODE, Processes, python_command

COUNTS = {"quick": 300, "full": 20_000}
START = 120.0  # s until a node answers after it was started, on a busy machine
AGAIN = 5.0  # s until a question is repeated
ANSWER = 30.0  # s until it answers after lies, or tells its health; more counts as a hang
HEALTH = 3.0  # s without diagnostics, which come every second, until they are awaited
ROUND = 24  # lies before a question
SHARE_OF_REQUESTS = 0.3  # of the lies; the others are messages
SHARE_OF_BYTES = 0.2  # of the messages, that are no message
SHARE_OF_CHANGES = 0.05  # of the requests that make a node deaf to other lies: those to change its state
COLUMNS = ("node", "endpoints", "lies", "starts", "deaths", "silent", "traces")
RCLError = rclpy_implementation.RCLError


@dataclass
class Outcome:
    """What became of the lies to one node."""

    name: str
    num_lies: int = 0
    num_endpoints: int = 0
    num_starts: int = 0
    deaths: list[str] = field(default_factory=list)
    silences: list[str] = field(default_factory=list)
    mistakes: Counter[str] = field(default_factory=Counter)  # tracebacks in the log: ours to mend


class Victim:
    """A node as what its command starts: a process, or two; its log is kept."""

    def __init__(self, case: Case, folder: Path, *, uses_sim_time: bool) -> None:
        values = case.values(folder) | {"use_sim_time": uses_sim_time}
        words = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
        node = case.node_class
        self.name, self.log = node.NAME, folder / f"{node.NAME}.log"
        self.has_loop = issubclass(node, FrontNode)
        self._nodes = Processes(folder)
        command = python_command(NODE.format(module=node.__module__), "--ros-args", *words)
        self._process = self._nodes.begin(self.name, command)

    @property
    def death(self) -> str:
        """How the process ended, which a loop does with its front; empty while it lives."""
        status = self._process.poll()
        if status is None:
            return ""
        return f"{self.name}: ended with {status}: {self._nodes.last_words(self.name) or 'no word'}"[:300]

    def close(self) -> None:
        """End the process, and the front of one that had to be killed: it would answer for its successor."""
        fronts = []
        with suppress(IndexError, OSError):
            fronts += [front_of(self._process.pid)] * self.has_loop
        self._nodes.end()
        for front in fronts:
            with suppress(ProcessLookupError):
                os.kill(front, signal.SIGKILL)

    def mistakes(self) -> Counter[str]:
        """Return the last lines of the tracebacks in the log, with the places they come from."""
        found: Counter[str] = Counter()
        text = self.log.read_text(encoding="utf-8", errors="replace")
        for block in re.findall(r"Traceback \(most recent call last\):\n((?:[ ]+.*\n)*)(.*)", text):
            places = re.findall(r'File "[^"]*/([^/"]+/[^/"]+)", line (\d+)', block[0])
            found[f"{block[1][:100]} ({':'.join(places[-1]) if places else '?'})"] += 1
        return found


class Interrogation:
    """A node that lies to a victim, in the order of a seed."""

    def __init__(self, case: Case, folder: Path, rng: np.random.Generator, *, uses_sim_time: bool) -> None:
        self._case, self._folder, self._rng, self._uses_sim_time = case, folder, rng, uses_sim_time
        kind = "sim time" if uses_sim_time else "system time"
        self.outcome, self._liar = Outcome(f"{case.node_class.NAME}, {kind}"), Liar(rng, is_now=True)
        self._node = Node("liar", start_parameter_services=False, enable_rosout=False)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._victim: Victim | None = None
        self._told: dict[str, float] = {}  # when the health of each process came last, s
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._hear, qos.STATE)
        self._topics: dict[str, Any] = {}
        self._clients: dict[str, Any] = {}

    def lie(self, count: int) -> Outcome:
        """Send so many lies; where the process dies of one it is started again."""
        try:
            while self.outcome.num_lies < count:
                if self._victim is None:
                    self._start()
                for _ in range(ROUND):
                    self._one()
                self._examine()
        finally:
            self._end()
            self._executor.shutdown()
            self._node.destroy_node()
        return self.outcome

    def _start(self) -> None:
        self._victim = Victim(self._case, self._folder, uses_sim_time=self._uses_sim_time)
        self.outcome.num_starts += 1
        if self._activate(START) is None:
            raise ValueError(f"{self._victim.name}: expected an answer within {START:g} s, {self._victim.death}")
        names = self._ask("list_parameters", ListParameters, ListParameters.Request(), ANSWER)
        self._liar.words = [] if names is None else list(names.result.names)
        loop, end = f"{self._victim.name}_loop", time.monotonic() + ANSWER
        while self._victim.has_loop and loop not in self._node.get_node_names() and time.monotonic() < end:
            time.sleep(0.1)
        time.sleep(0.5)  # its subscriptions come after its name
        self._find_endpoints()

    def _end(self) -> None:
        if self._victim is not None:
            self._victim.close()
            self.outcome.mistakes += self._victim.mistakes()
            self._victim = None
            self._told.clear()

    def _hear(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if any(pair.key == "failed" for pair in status.values):
                self._told[status.name.rpartition(": ")[2]] = time.monotonic()

    def _find_endpoints(self) -> None:
        """Make a publisher for each topic and a client for each service of all nodes of the process."""
        for name, message in self._case.sends().items():  # a recorder subscribes to what there is
            topic = f"/{name.lstrip('/')}"
            if topic not in self._topics:
                self._topics[topic] = self._node.create_publisher(type(message), topic, qos.LATCHED)
        own = (self._node.get_name(), self._node.get_namespace())
        for name, namespace in set(self._node.get_node_names_and_namespaces()) - {own}:
            for topic, kinds in self._node.get_subscriber_names_and_types_by_node(name, namespace):
                if topic not in self._topics:
                    self._topics[topic] = self._node.create_publisher(interface_class(kinds[0]), topic, qos.LATCHED)
            for service, kinds in self._node.get_service_names_and_types_by_node(name, namespace):
                if service not in self._clients:
                    self._clients[service] = self._node.create_client(interface_class(kinds[0]), service)
        self.outcome.num_endpoints = len(self._topics) + len(self._clients)

    def _one(self) -> None:
        self.outcome.num_lies += 1
        if not self._topics or self._rng.random() < SHARE_OF_REQUESTS:
            client = self._clients[self._rng.choice(sorted(self._clients))]
            if client.srv_type is not ChangeState or self._rng.random() < SHARE_OF_CHANGES:
                answer = client.call_async(self._liar.message(client.srv_type.Request))
                answer.add_done_callback(lambda done: None)
                client.remove_pending_request(answer)
            return
        topic = str(self._rng.choice(sorted(self._topics)))
        publisher = self._topics[topic]
        sends = {f"/{name.lstrip('/')}": message for name, message in self._case.sends().items()}
        message = self._liar.message(publisher.msg_type)
        if topic in sends and self._rng.random() < 0.5:
            message = mutate_message(sends[topic], self._rng)
        try:
            publisher.publish(self._liar.raw(message) if self._rng.random() < SHARE_OF_BYTES else message)
        except (RCLError, SystemError, OverflowError, AssertionError, TypeError, ValueError):  # too wrong to be sent
            publisher.publish(self._liar.message(publisher.msg_type))

    def _examine(self) -> None:
        """Ask the node; note its death, or its silence."""
        assert self._victim is not None
        answer = self._ask("get_state", GetState, GetState.Request(), ANSWER)
        state = answer and answer.current_state.id
        if answer is None or not self._is_told(state):
            death = self._victim.death
            silence = "no answer" if answer is None else "no diagnostics"
            where = self.outcome.deaths if death else self.outcome.silences
            where.append(f"{death or f'{self._victim.name}: {silence} for {ANSWER:g} s'} (lie {self.outcome.num_lies})")
            self._end()
            return
        is_active = state == State.PRIMARY_STATE_ACTIVE
        if not is_active and self._rng.random() < 0.5 and self._activate(ANSWER) != State.PRIMARY_STATE_ACTIVE:
            self._end()  # shut down as it was asked to, or without a file that it needs: it starts anew

    def _is_told(self, state: int) -> bool:
        """Whether the health of the node was told lately, or comes; that of its loop, too, where it is configured."""
        assert self._victim is not None
        has_loop = self._victim.has_loop and state in (State.PRIMARY_STATE_INACTIVE, State.PRIMARY_STATE_ACTIVE)
        names = ["callbacks", "callbacks of the loop"] if has_loop else ["callbacks"]
        since = time.monotonic() - HEALTH
        while any(self._told.get(name, 0.0) < since for name in names):
            if self._victim.death or time.monotonic() > since + HEALTH + ANSWER:
                return False
            self._executor.spin_once(timeout_sec=0.2)
        return True

    def _activate(self, patience: float) -> int | None:
        """Have the node active where that can be; its state, None without an answer."""
        for _ in range(3):
            answer = self._ask("get_state", GetState, GetState.Request(), patience)
            if answer is None:
                return None
            state = int(answer.current_state.id)
            step = {State.PRIMARY_STATE_UNCONFIGURED: Transition.TRANSITION_CONFIGURE}
            step |= {State.PRIMARY_STATE_INACTIVE: Transition.TRANSITION_ACTIVATE}
            if state not in step:
                return state
            request = ChangeState.Request(transition=Transition(id=step[state]))
            self._ask("change_state", ChangeState, request, patience)
        return state

    def _ask(self, service: str, kind: type[Any], request: Any, patience: float) -> Any:
        """Return the answer of a service of the node; None where it is dead or silent."""
        name = f"/{self._case.node_class.NAME}/{service}"
        if name not in self._clients:
            self._clients[name] = self._node.create_client(kind, name)
        client, end = self._clients[name], time.monotonic() + patience
        while self._victim is not None and not self._victim.death and time.monotonic() < end:
            if not client.service_is_ready():
                time.sleep(0.02)
                continue
            answer: Future = client.call_async(request)
            again = time.monotonic() + AGAIN  # one that is sent while the two still find each other may be lost
            while not answer.done() and time.monotonic() < min(again, end) and not self._victim.death:
                self._executor.spin_once(timeout_sec=0.2)
            if answer.done():
                return answer.result()
            client.remove_pending_request(answer)
        return None


def interrogate(cases: Sequence[tuple[Case, bool]], count: int, seed: int) -> list[Outcome]:
    """Lie to each node, on the clock of the system or on /clock (True), `count` lies in all."""
    rclpy.init()
    outcomes = []
    try:
        for number, (case, uses_sim_time) in enumerate(cases):
            with tempfile.TemporaryDirectory() as folder, chdir(folder):  # for files of lied names
                rng = np.random.default_rng([seed, number])
                interrogation = Interrogation(case, Path(folder), rng, uses_sim_time=uses_sim_time)
                outcomes.append(interrogation.lie(-(-count // len(cases))))
    finally:
        rclpy.try_shutdown()
    return outcomes


def run(options: argparse.Namespace) -> Report:
    """Lie to every node on both clocks, or to three of them."""
    cases = [(case, clock) for case in CASES for clock in (False, True)]
    if options.size == "quick":
        cases = random.Random(options.seed).sample(cases, min(3, len(cases)))
    outcomes = interrogate(cases, COUNTS[options.size], options.seed)
    report, rows = Report("endpoints", notes=[__doc__ or ""]), []
    for o in outcomes:
        counts = o.num_endpoints, o.num_lies, o.num_starts, len(o.deaths), len(o.silences), o.mistakes.total()
        rows.append((o.name, *map(str, counts)))
    report.tables.append(Table("Lies", COLUMNS, rows))
    deaths = [death for outcome in outcomes for death in outcome.deaths]
    silences = [silence for outcome in outcomes for silence in outcome.silences]
    traces = [f"{n} x {o.name}: {line}" for o in outcomes for line, n in o.mistakes.most_common()]
    for title, lines in (("Deaths", deaths), ("Silences", silences), ("Tracebacks", traces)):
        report.tables.append(Table(title, ("what",), [(line.replace("|", "/"),) for line in lines[:100]]))
    total, told = sum(o.num_lies for o in outcomes), Headline("robustness", f"{len(cases)} processes")
    report.bounds += [
        Bound(f"processes that died of {total} lies", 0, len(deaths), "", headline=told),
        Bound(f"processes that were silent for {ANSWER:g} s", 0, len(silences), ""),
    ]
    return report
