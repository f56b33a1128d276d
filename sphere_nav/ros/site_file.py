"""The parameter file of a site: its sections name nodes that exist, its parameters those that these nodes declare.

rclpy ignores what no node asks for, so a misspelt limit would leave its default without a word. Names are those of the
shipped `config/<node>.yaml`; whether a value fits, each node says when it starts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from sphere_nav.geometry.files.untrusted import MAX_FILE_BYTES, load_yaml, read_text, required, short
from sphere_nav.params import meant
from sphere_nav.ros.shared_files import share_file

ALL = "/**"  # the section of all nodes; that of one lies below it, so that it holds in every namespace
BODY = "ros__parameters"
RCLPY_NAMES, RCLPY_GROUPS = {"use_sim_time", "start_type_description_service"}, ("qos_overrides.",)


def check_site_file(path: str, nodes: Sequence[str]) -> None:
    """Raise ValueError in one line unless all that a file says is heard by one of `nodes`."""
    known = {f"{ALL}/{node}": _names_of(share_file(f"config/{node}.yaml")) for node in nodes}
    known[ALL] = set().union(*known.values())
    content = load_yaml(path, read_text(path, "parameter file", MAX_FILE_BYTES))
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


def _names_of(path: Path) -> set[str]:
    """Return the parameters in the shipped file of a node."""
    (content,) = load_yaml(path, read_text(path, "parameter file", MAX_FILE_BYTES)).values()
    return set(_flat(content[BODY], ""))


def _flat(values: Mapping[Any, Any], prefix: str) -> Iterator[str]:
    """Yield the dotted names of parameters."""
    for key, value in values.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            yield from _flat(value, f"{name}.")
        else:
            yield name
