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

from sphere_nav.cli.demo.processes import PATIENCE, node_command
from sphere_nav.ros.compositions import COMPOSITIONS, Composition, NodeStart

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
LOOK = 0.2  # s between two looks at what still runs


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
    starts = composition.starts(parse(arguments.arguments))
    with tempfile.TemporaryDirectory(prefix="sphere_nav_up_") as folder, _interruptible():
        running: list[tuple[str, subprocess.Popen[bytes]]] = []
        try:
            for number, start in enumerate(starts):
                command = node_command(start.node, *ros_arguments(start, Path(folder) / f"{number}.yaml"))
                running.append((start.node, subprocess.Popen(command, start_new_session=True)))
            return _watch(running)
        except KeyboardInterrupt:
            return 0
        finally:
            _end(running)


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
    for topic, target in start.topics.items():
        words += ["-r", f"{topic}:={target}"]
    for parameters in (start.site, str(file)):
        words += ["--params-file", parameters] if parameters else []
    return words


def _watch(running: list[tuple[str, subprocess.Popen[bytes]]]) -> int:
    """Wait while nodes run; 1 as soon as one of them fails."""
    while any(process.poll() is None for _, process in running):
        for node, process in running:
            if process.poll():
                print(f"up: {node} ended with status {process.returncode}; the others end, too", file=sys.stderr)
                return 1
        time.sleep(LOOK)
    return max(abs(process.returncode) for _, process in running) and 1


def _end(running: list[tuple[str, subprocess.Popen[bytes]]]) -> None:
    """End what still runs as Ctrl-C would, the last one started first."""
    for _, process in reversed(running):
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
    for _, process in reversed(running):
        try:
            process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


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
