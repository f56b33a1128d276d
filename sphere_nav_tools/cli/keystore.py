"""`sphere_nav keystore`: keys and permissions (SROS2) of nodes that belong together, by `ros2 security`."""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

from sphere_nav.ros.camera.drivers import topics_by_driver
from sphere_nav.ros.compositions import COMPOSITIONS, NodeStart
from sphere_nav.ros.shared_files import share_file
from sphere_nav_tools.cli.up import parse
from sphere_nav_tools.offline.settings import add

HELP = """\
Make the keys of nodes that belong together (SROS2): a keystore, an enclave for each node that `sphere_nav up NAME`
starts, and the enclaves vehicle (drivers, base), operator (page, terminal) and bag_recorder. Each gets the permissions
of config/security.policy.xml, with the topics and the namespace that the arguments name. The keys are of the domain
ROS_DOMAIN_ID. `ros2 security` (package sros2) must be on the PATH.

examples:
  sphere_nav keystore keys navigation map:=maps/campus image:=/front/image_raw guard:=true
  sphere_nav keystore keys mapping rig:=rig.yaml namespace:=car2
"""
BESIDE = ("vehicle", "operator", "bag_recorder")  # beside what a composition starts
FIND_SROS2 = "ros2 security: expected the tools of the package sros2 (apt install ros-jazzy-sros2)"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add(parser, "folder", "FOLDER", "keystore; what is in it already is kept")
    add(parser, "name", "NAME", "what is to be started", choices=tuple(COMPOSITIONS))
    add(parser, "arguments", "ARGUMENT:=VALUE", "the same as of sphere_nav up NAME", nargs="*")


def run(arguments: argparse.Namespace) -> None:
    """Have `ros2 security` make the keys; ValueError where it cannot."""
    starts = COMPOSITIONS[arguments.name].starts(parse(arguments.arguments))
    ros2 = shutil.which("ros2")
    if ros2 is None:
        raise ValueError(f"{FIND_SROS2}, found no ros2 on the PATH")
    with tempfile.TemporaryDirectory(prefix="sphere_nav_keystore_") as folder:
        file = Path(folder) / "policy.xml"
        policy_of(starts).write(file, encoding="utf-8", xml_declaration=True)
        command = [ros2, "security", "generate_artifacts", "-k", arguments.folder, "-p", str(file)]
        done = subprocess.run(command, capture_output=True, text=True, check=False, umask=0o077)  # keys are ours alone
    if done.returncode:
        said = (done.stdout + done.stderr).rstrip().rpartition("\n")[2]
        raise ValueError(f"{FIND_SROS2}, found: {said or 'no word of it'}")
    print(f"{arguments.folder}: keys for domain {os.environ.get('ROS_DOMAIN_ID', '0')}")


def policy_of(starts: Sequence[NodeStart]) -> ElementTree.ElementTree[ElementTree.Element]:
    """Return the policy of nodes as they are started: their enclaves, namespace and topics."""
    policy, namespace = ElementTree.parse(share_file("config/security.policy.xml")), starts[0].namespace
    started = {start.node: [start] for start in starts} | dict.fromkeys(BESIDE, starts)
    for enclaves in policy.iter("enclaves"):
        for enclave in list(enclaves):
            name = enclave.get("path", "").lstrip("/")
            if name not in started:
                enclaves.remove(enclave)
                continue
            enclave.set("path", f"/{namespace}/{name}" if namespace else f"/{name}")
            for profile in enclave.iter("profile"):
                profile.set("ns", f"/{namespace}")
            for topics in enclave.iter("topics"):
                _rename(topics, started[name])
    return policy


def _rename(topics: ElementTree.Element, starts: Sequence[NodeStart]) -> None:
    """Put in place of each topic what it is called by any of the nodes."""
    names = [str(topic.text) for topic in topics]
    maps = [{**topics_by_driver(str(start.parameters.get("driver", ""))), **start.topics} for start in starts]
    topics[:] = []
    for name in dict.fromkeys(_renamed(name, map_) for name in names for map_ in maps):
        ElementTree.SubElement(topics, "topic").text = name


def _renamed(name: str, renamed: Mapping[str, str]) -> str:
    """Return the new name of a topic; what lies below an image goes with it."""
    base = name if name in renamed else name.rpartition("/")[0]
    return renamed[base] + name.removeprefix(base) if base in renamed else name
