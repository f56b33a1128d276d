"""The parameter file of a site: its sections name nodes that exist, its parameters those that these nodes declare.

rclpy ignores what no node asks for, so a misspelt limit would leave its default without a word. Names are those of the
shipped `config/<node>.yaml`; whether a value fits, each node says when it starts.

So with rules that rename topics (`-r FROM:=TO`): what each node may open stands in the policy, `*` for any word. What
only other nodes know a launch file may give to all of its nodes at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from sphere_nav.geometry.files.untrusted import MAX_FILE_BYTES, load_yaml, read_text, required, short
from sphere_nav.params import meant
from sphere_nav.ros.constants import ABSOLUTE
from sphere_nav.ros.shared_files import share_file

POLICY = "config/security.policy.xml"
STRANGERS = ("vehicle", "operator")  # enclaves of the policy that are none of our nodes
ALL = "/**"  # the section of all nodes; that of one lies below it, so that it holds in every namespace
BODY = "ros__parameters"
RCLPY_NAMES, RCLPY_GROUPS = {"use_sim_time", "start_type_description_service"}, ("qos_overrides.",)


def check_site_file(path: str, nodes: Sequence[str]) -> None:
    """Raise ValueError in one line unless all that a file says is heard by one of `nodes`."""
    known = {}
    for node in nodes:
        (shipped,) = _read(share_file(f"config/{node}.yaml")).values()
        known[f"{ALL}/{node}"] = set(_flat(shipped[BODY], ""))
    known[ALL] = set().union(*known.values())
    content = _read(path)
    if not isinstance(content, dict) or not content:
        raise ValueError(f"{path}: expected sections such as {ALL}, found {short(content)}")
    for section, below in content.items():
        place = f"{path}: {section}"
        if section not in known:
            expected = f"{ALL}, or {ALL}/ and one of {', '.join(nodes)}"
            raise ValueError(f"{place}{meant(str(section), known)}: expected {expected}, found this section")
        for name in _flat(required(below, place, [BODY])[BODY], ""):
            if name not in known[section] | RCLPY_NAMES and not name.startswith(RCLPY_GROUPS):
                hint = meant(name, known[section])
                raise ValueError(f"{place}: {name}{hint}: expected a parameter of these nodes, found none")


def _read(path: str | Path) -> Any:
    return load_yaml(path, read_text(path, "parameter file", MAX_FILE_BYTES))


def _flat(values: Mapping[Any, Any], prefix: str) -> Iterator[str]:
    """Yield the dotted names of parameters."""
    for key, value in values.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            yield from _flat(value, f"{name}.")
        else:
            yield name


# --- rules that rename
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
    for before, word in pairwise(words):
        rule = word.partition(":=")[0].removeprefix("rostopic://").removeprefix("rosservice://")
        whose, _, renamed = rule.rpartition(":")
        if before in ("-r", "--remap") and whose in ("", name) and not renamed.startswith("__"):
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
