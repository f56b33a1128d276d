"""A parameters class as a ROS parameter file with comments, or as a Markdown list."""

from __future__ import annotations

import json

from sphere_nav.params import Leaf, leaves


def to_yaml(*classes: type, node: str = "/**") -> str:
    """Return a ROS 2 parameter file with every default of the classes, its meaning as comment above it."""
    lines = [f"{node}:", "  ros__parameters:"]
    open_groups: list[str] = []
    for leaf in (leaf for cls in classes for leaf in leaves(cls)):
        *groups, name = leaf.name.split(".")
        for depth, part in enumerate(groups):
            if open_groups[: depth + 1] != groups[: depth + 1]:
                lines.append("  " * (depth + 2) + f"{part}:")
        open_groups = groups
        indent = "  " * (len(groups) + 2)
        lines += [f"{indent}# {leaf.meaning()}", f"{indent}{name}: {_literal(leaf)}"]
    return "\n".join(lines) + "\n"


def to_markdown(cls: type) -> str:
    """Return a list with one line a parameter."""
    return "".join(f"- `{leaf.name}: {_literal(leaf)}`: {leaf.meaning()}\n" for leaf in leaves(cls))


def _literal(leaf: Leaf) -> str:
    if leaf.type is float:  # rclpy refuses an integer for a float parameter
        text = repr(float(leaf.default))
        return text if any(mark in text for mark in ".n") else text.replace("e", ".0e")
    return json.dumps(leaf.default)
