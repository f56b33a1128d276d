"""`sphere_nav up`: nodes that belong together, as `ros2 launch` would start them."""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from sphere_nav.ros.compositions import COMPOSITIONS, Composition, after_exit
from sphere_nav_tools.cli.constants import LOOK_S
from sphere_nav_tools.cli.processes import Processes, start_command
from sphere_nav_tools.offline.settings import add
from sphere_nav_tools.offline.tables import columns

LISTING = "\n".join(columns((f"  {name}", composition.purpose) for name, composition in COMPOSITIONS.items()))
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
    add(parser, "name", "NAME", "what to start", choices=tuple(COMPOSITIONS))
    add(parser, "arguments", "ARGUMENT:=VALUE", "as ros2 launch takes them", nargs="*")
    parser.add_argument("-s", "--show-args", action="store_true", help="show the arguments and start nothing")


def run(arguments: argparse.Namespace) -> int:
    """Start all, wait until they end or are told to, and end those that are left."""
    composition = COMPOSITIONS[arguments.name]
    if arguments.show_args:
        print(argument_table(composition))
        return 0
    starts = composition.ready(parse(arguments.arguments))
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends as Ctrl-C does
    with tempfile.TemporaryDirectory(prefix="sphere_nav_up_") as folder, Processes() as nodes:
        try:
            status = watch(nodes, {start.node: start_command(start, Path(folder)) for start in starts})
        except KeyboardInterrupt:
            status = 0
        statuses = nodes.end()
    for node, left in statuses.items():
        if left > 0:
            print(f"up: {node} ended with status {left}", file=sys.stderr)
    return 1 if set(statuses.values()) - {0, -signal.SIGINT} else status


def parse(words: Sequence[str]) -> dict[str, str]:
    """Return what `name:=value` says; ValueError for anything else."""
    for word in words:
        if ":=" not in word:
            raise ValueError(f"arguments: expected NAME:=VALUE, found {word!r}")
    return dict(word.split(":=", 1) for word in words)


def argument_table(composition: Composition) -> str:
    """Return what -s shows."""
    rows = []
    for name, argument in composition.arguments.items():
        default = "must be given" if argument.default is None else f"default {argument.default!r}"
        choices = f", one of {', '.join(argument.choices)}" if argument.choices else ""
        rows.append((f"  {name}", f"{argument.meaning} ({default}{choices})"))
    return "\n".join([f"{composition.purpose}; arguments as NAME:=VALUE", *columns(rows)])


def watch(nodes: Processes, commands: Mapping[str, list[str]]) -> int:
    """Start nodes by their commands, and again where they may; 1 as soon as one ends that the others need."""
    num_restarts, due = Counter[str](), dict[str, float]()  # s, of steady time: when it starts again
    for node, command in commands.items():
        nodes.begin(node, command)
    while nodes.running or due:
        for node, status in nodes.take_ended().items():
            try:
                delay = after_exit(node, status, num_restarts[node])
            except RuntimeError as error:
                print(f"up: {error}", file=sys.stderr)
                return 1
            if delay is not None:
                due[node] = time.monotonic() + delay
                print(f"up: {node} ended with status {status}; it starts again", file=sys.stderr)
        for node in [node for node, at in due.items() if time.monotonic() >= at]:
            del due[node]
            num_restarts[node] += 1
            nodes.begin(node, commands[node])
        time.sleep(LOOK_S)
    return 0
