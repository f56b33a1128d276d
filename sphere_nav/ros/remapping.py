"""Rules that rename topics, of a node's command line (`-r FROM:=TO`): rclpy takes any name, also of what nobody opens.

What each node may open stands in the policy, `*` for any word; so do the names that only other nodes know, which a
launch file may give to all of its nodes at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from itertools import pairwise
from xml.etree import ElementTree

from sphere_nav.ros.constants import ABSOLUTE
from sphere_nav.ros.shared_files import share_file
from sphere_nav.ros.site_file import meant

POLICY = "config/security.policy.xml"
STRANGERS = ("vehicle", "operator")  # enclaves of the policy that are none of our nodes


def check_rules(words: Sequence[str], node: str, name: str, namespace: str, heard: Mapping[str, str]) -> list[str]:
    """Return a line for each rule of a name that only other nodes know; ValueError for one that no node knows.

    `words` are those of the command line; `name` and `namespace` are what the node is called there, `heard` the topics
    of a camera's driver by ours.
    """
    rules = [_full(rule, node, name, namespace) for rule in _rules(words, name)]
    names = _names() if rules else {}
    lines = []
    for rule in rules if node in names else ():
        if f"/{rule}" in ABSOLUTE or _is_known(rule, [*names[node], *(f"{topic}*" for topic in heard.values())]):
            continue
        line = f"-r {rule}{meant(rule, names[node])}: expected a topic or service of {node}, found one of"
        if not any(_is_known(rule, others) for others in names.values() if "*" not in others):
            raise ValueError(f"{line} no node")
        lines.append(f"{line} other nodes: it renames nothing here")
    return lines


def _rules(words: Sequence[str], name: str) -> Iterator[str]:
    """Yield the names that rules for a node, or for all, give other ones; those of nodes and namespaces left out."""
    is_ros = False
    for before, word in pairwise(["", *words]):
        is_ros = before != "--" and (is_ros or before == "--ros-args")
        rule = word.partition(":=")[0].removeprefix("rostopic://").removeprefix("rosservice://")
        whose, _, renamed = rule.rpartition(":")
        if is_ros and before in ("-r", "--remap") and whose in ("", name) and not renamed.startswith("__"):
            yield renamed


def _full(rule: str, node: str, name: str, namespace: str) -> str:
    """Return what a rule renames as the policy has it: without the namespace, with the node's usual name."""
    below = rule.removeprefix(f"{namespace.rstrip('/')}/").lstrip("/")
    own = next((start for start in ("~/", f"{name}/") if below.startswith(start)), "")
    return f"{node}/{below.removeprefix(own)}" if own else below


def _names() -> dict[str, list[str]]:
    """Return what each of our nodes opens: topics, services and actions."""
    names: dict[str, list[str]] = {}
    for enclave in ElementTree.parse(share_file(POLICY)).iter("enclave"):
        node = enclave.get("path", "").lstrip("/")
        if node not in STRANGERS:
            found = (item.text or "" for kind in ("topic", "service", "action") for item in enclave.iter(kind))
            names[node] = [name.replace("~", node, 1).lstrip("/") for name in found]
    return names


def _is_known(rule: str, names: Iterable[str]) -> bool:
    return any(fnmatchcase(rule, name) for name in names)
