"""`sphere_nav operate`: the operator's page, in a web browser."""

from __future__ import annotations

import argparse
import os
import shlex
import threading
from contextlib import ExitStack, closing
from pathlib import Path

from sphere_nav_tools.cli import gate
from sphere_nav_tools.cli.operate.link import Link
from sphere_nav_tools.cli.operate.page import OperatorPage
from sphere_nav_tools.cli.operate.teaching import SimulatedVehicle, Teaching
from sphere_nav_tools.offline.settings import add, flag

HELP = """\
Serve a page in a web browser: teach a drive, make its map, choose a path or a place and go, pause, stop, and see on the
map where the vehicle is, what it does, why it stands and what to do. The nodes run by themselves (`sphere_nav up
navigation`); losing the page changes nothing, unless its dead-man switch is on.

It serves this machine only, unless --host says otherwise. The link that it prints has a token in it; nobody comes in
without. The emergency stop of the page does not replace the one on the vehicle.

examples:
  sphere_nav operate --simulator --folder maps
  sphere_nav operate --folder maps
  sphere_nav operate --folder maps --host 0.0.0.0
  sphere_nav operate --folder maps --namespace car2 --map-options "--rig rig.yaml"
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "--folder", "DIR", "of recordings, maps and paths (.)", Path, default=Path())
    flag(parser, "--simulator", "with a simulated vehicle, in a ROS domain of its own")
    gate.add_options(parser, "operate")
    add(parser, "--namespace", "NAMESPACE", "of the vehicle's nodes", default="")
    add(parser, "--image", "TOPIC", "picture to show (%(default)s)", default="image_raw")
    add(parser, "--record", "TOPICS", "to record (cameras, laser, IMU, odometry, tf)", default="")
    add(parser, "--map-options", "WORDS", "more words for `sphere_nav map`", default="")


def run(arguments: argparse.Namespace) -> None:
    """Serve until interrupted."""
    address = gate.address_of("operate", arguments)
    folder = arguments.folder.resolve()
    if not folder.is_dir():
        raise ValueError(f"--folder: expected a folder, found {folder}")
    what = ["-p", f"topics:={arguments.record}"] if arguments.record else ["-p", "topic_set:=raw"]
    with ExitStack() as stack:
        simulated = stack.enter_context(SimulatedVehicle(folder)) if arguments.simulator else None
        if simulated is not None:
            os.environ.update(simulated.environment)
            what = ["-p", "topic_set:=all", "-p", "use_sim_time:=true"]
        teaching = stack.enter_context(Teaching(folder, what, shlex.split(arguments.map_options)))
        link = stack.enter_context(closing(Link(arguments.namespace, arguments.image)))
        page = stack.enter_context(closing(OperatorPage(address, link, teaching, simulated)))
        print(f"{page.url}  (Ctrl-C ends it)", flush=True)
        threading.Event().wait()
