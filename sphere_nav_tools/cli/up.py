"""`sphere_nav up`: nodes that belong together, as `ros2 launch` would start them."""

from __future__ import annotations

import argparse
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from sphere_nav.ros.compositions import COMPOSITIONS, Composition, NodeStart, after_exit
from sphere_nav.ros.constants import END_PATIENCE_S
from sphere_nav_tools.cli.constants import LOOK
from sphere_nav_tools.cli.processes import node_command

LISTING = "\n".join(f"  {name:<13} {composition.purpose}" for name, composition in COMPOSITIONS.items())
HELP = f"""\
Start nodes that belong together; Ctrl-C ends them in order. NAME starts what `ros2 launch sphere_nav NAME.launch.py`
starts, with the same arguments; -s shows them.

{LISTING}

examples:
  sphere_nav up navigation -s
  sphere_nav up navigation map:=maps/campus trajectory:=maps/campus.tum image:=/front/image_raw info:=/front/camera_info
  sphere_nav up mapping rig:=rig.yaml namespace:=car2
  sphere_nav up simulation mode:=teach record:=drive
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("name", metavar="NAME", choices=tuple(COMPOSITIONS), help="what to start")
    parser.add_argument("arguments", nargs="*", metavar="ARGUMENT:=VALUE", help="as ros2 launch takes them")
    parser.add_argument("-s", "--show-args", action="store_true", help="show the arguments and start nothing")


def run(arguments: argparse.Namespace) -> int:
    """Start all, wait until they end or are told to, and end those that are left."""
    composition = COMPOSITIONS[arguments.name]
    if arguments.show_args:
        print(argument_table(composition))
        return 0
    starts = composition.ready(parse(arguments.arguments))
    with tempfile.TemporaryDirectory(prefix="sphere_nav_up_") as folder, _interruptible():
        running: list[Running] = []
        try:
            for number, start in enumerate(starts):
                words = ros_arguments(start, Path(folder) / f"{number}.yaml")
                running.append(Running(start.node, node_command(start.node, *words)))
            status = _watch(running)
        except KeyboardInterrupt:
            status = 0
        finally:
            failed = _end(running)
        return 1 if failed else status


class Running:
    """A node as a process, which may be started again."""

    def __init__(self, node: str, command: list[str]) -> None:
        self.node, self.command, self.num_restarts = node, command, 0
        self.due: float | None = None  # s, of steady time: when it starts again
        self.start()

    def start(self) -> None:
        """Start the process; Ctrl-C reaches us alone."""
        self.process, self.is_over = subprocess.Popen(self.command, start_new_session=True), False

    def look(self, now: float) -> None:
        """Start the node again where it has ended and may; RuntimeError: all must end."""
        status = self.process.poll()
        if status is not None and not self.is_over:
            delay = after_exit(self.node, status, self.num_restarts)
            self.is_over, self.due = True, None if delay is None else now + delay
            if delay is not None:
                print(f"up: {self.node} ended with status {status}; it starts again", file=sys.stderr)
        if self.due is not None and now >= self.due:
            self.due, self.num_restarts = None, self.num_restarts + 1
            self.start()


def parse(words: Sequence[str]) -> dict[str, str]:
    """Return what `name:=value` says; ValueError for anything else."""
    for word in words:
        if ":=" not in word:
            raise ValueError(f"arguments: expected NAME:=VALUE, found {word!r}")
    return dict(word.split(":=", 1) for word in words)


def argument_table(composition: Composition) -> str:
    """Return what -s shows."""
    lines = [f"{composition.purpose}; arguments as NAME:=VALUE"]
    for name, argument in composition.arguments.items():
        default = "must be given" if argument.default is None else f"default {argument.default!r}"
        choices = f", one of {', '.join(argument.choices)}" if argument.choices else ""
        lines.append(f"  {name:<16} {argument.meaning} ({default}{choices})")
    return "\n".join(lines)


def ros_arguments(start: NodeStart, file: Path) -> list[str]:
    """Return the words after a node's name; its parameters go into a file, the site's before it."""
    values = {"/**": {"ros__parameters": dict(start.parameters)}}
    file.write_text(yaml.safe_dump(values), encoding="utf-8")
    words = ["--ros-args", *(["-r", f"__ns:=/{start.namespace}"] if start.namespace else [])]
    words += ["--enclave", start.enclave] if start.enclave else []
    for topic, target in start.topics.items():
        words += ["-r", f"{topic}:={target}"]
    for parameters in (start.site, str(file)):
        words += ["--params-file", parameters] if parameters else []
    return words


def _watch(running: list[Running]) -> int:
    """Wait while nodes run; 1 as soon as one has ended without which the others make no sense."""
    while not all(item.is_over and item.due is None for item in running):
        try:
            for item in running:
                item.look(time.monotonic())
        except RuntimeError as error:
            print(f"up: {error}", file=sys.stderr)
            return 1
        time.sleep(LOOK)
    return 0


def _end(running: list[Running]) -> bool:
    """End what still runs as Ctrl-C would, the last one started first; whether one of them says that it failed."""
    failed = False
    left = [item for item in reversed(running) if item.process.poll() is None]
    for item in left:
        item.process.send_signal(signal.SIGINT)
    for item in left:
        try:
            status = item.process.wait(END_PATIENCE_S)
        except subprocess.TimeoutExpired:
            item.process.kill()
            status = item.process.wait()
        if status > 0:
            print(f"up: {item.node} ended with status {status}", file=sys.stderr)
        failed |= status != 0 and status != -signal.SIGINT
    return failed


@contextmanager
def _interruptible() -> Iterator[None]:
    """Let SIGTERM end as Ctrl-C does."""

    def interrupt(number: int, frame: Any) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
