"""The parameter file of a site: its sections name nodes that exist, its parameters those that these nodes declare.

rclpy ignores what no node asks for, so a misspelt limit would leave its default without a word. Names are those of the
shipped `config/<node>.yaml`; whether a value fits, each node says when it starts.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from sphere_nav.geometry.files.untrusted import MAX_FILE_BYTES, load_yaml, read_text
from sphere_nav.ros.shared_files import share_file

BODY = "ros__parameters"
ANY = {"*", "**"}  # tokens of a section's name that stand for nodes
RCLPY_NAMES, RCLPY_GROUPS = {"use_sim_time", "start_type_description_service"}, ("qos_overrides.",)


def meant(name: str, known: Iterable[str]) -> str:
    """Return a hint at the known name that is most like one, or nothing."""
    close = difflib.get_close_matches(name, list(known), n=1)
    return f" (is {close[0]} meant?)" if close else ""


def check_site_file(path: str, nodes: Sequence[str], started: Sequence[str]) -> None:
    """Raise ValueError in one line unless all that a file says is heard by one of `nodes`.

    `started` are full names of those that start now, which a section that means them must reach.
    """
    known = {node: _declared(node) for node in nodes}
    content = load_yaml(path, read_text(path, "parameter file", MAX_FILE_BYTES))
    if not isinstance(content, dict) or not content:
        raise ValueError(f"{path}: expected sections such as /**, found {type(content).__name__}")
    for section, values in _sections(path, content, ""):
        place = f"{path}: {section}"
        last = section.rsplit("/", 1)[-1]
        if last not in known and last not in ANY:
            hint = meant(last, known)
            raise ValueError(f"{place}{hint}: expected /** or /**/ and one of {', '.join(known)}, found this section")
        mine = [name for name in started if name.rsplit("/", 1)[-1] == last]
        if mine and not any(_reaches(section, name) for name in mine):
            raise ValueError(f"{place}: expected a name for {mine[0].replace('//', '/')}, such as /**/{last}")
        heard = known[last] if last in known else set().union(*known.values())
        for name in _flat(values, ""):
            if name not in heard | RCLPY_NAMES and not name.startswith(RCLPY_GROUPS):
                whose = last if last in known else "any node"
                raise ValueError(f"{place}: {name}{meant(name, heard)}: expected a parameter of {whose}, found none")


def _declared(node: str) -> set[str]:
    path = share_file(f"config/{node}.yaml")
    (content,) = load_yaml(path, read_text(path, "parameter file", MAX_FILE_BYTES)).values()
    return set(_flat(content[BODY], ""))


def _sections(path: str, tree: Mapping[Any, Any], prefix: str) -> Iterator[tuple[str, Mapping[Any, Any]]]:
    """Yield name and parameters of each section; a name may be nested, namespace by namespace."""
    for key, value in tree.items():
        name = f"{prefix}/{str(key).strip('/')}"
        if not isinstance(value, dict):
            raise ValueError(f"{path}: {name}: expected {BODY} below it, found {type(value).__name__}")
        inner = {word: below for word, below in value.items() if word != BODY}
        if BODY in value:
            if not isinstance(value[BODY], dict):
                raise ValueError(f"{path}: {name}: {BODY}: expected parameters, found {type(value[BODY]).__name__}")
            yield name, value[BODY]
        if inner or BODY not in value:
            yield from _sections(path, inner, name)


def _flat(values: Mapping[Any, Any], prefix: str) -> Iterator[str]:
    """Yield the dotted names of parameters."""
    for key, value in values.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            yield from _flat(value, f"{name}.")
        else:
            yield name


def _reaches(section: str, name: str) -> bool:
    """Whether a section holds for a node, both by full name; ** are any namespaces, * is one."""
    words = {"**": "(/[^/]+)*", "*": "/[^/]+"}
    pattern = "".join(words.get(word, f"/{re.escape(word)}") for word in section.strip("/").split("/"))
    return re.fullmatch(pattern, "/" + name.strip("/").replace("//", "/")) is not None
