"""YAML from outside: no key twice, bounded in size and depth, aliases written out, before anything is built."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

MAX_TEXT = 1 << 20  # characters
MAX_DEPTH = 32
MAX_REPEATED = 1 << 14  # values that aliases stand for, all together
MAX_WORD = 4096  # characters without quotes; the sexagesimal numbers of YAML 1.1 take time by the square of theirs

MERGE = "tag:yaml.org,2002:merge"

Base: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class StrictLoader(Base):  # type: ignore[misc]
    """Refuses a key that comes twice, which YAML would pass over."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        """Return the mapping of a node; ConstructorError where a key comes twice."""
        own = [key for key, _ in node.value if key.tag != MERGE]  # those it merges, it may override
        found = super().construct_mapping(node, deep=True)  # refuses keys that cannot be compared
        keys = [self.construct_object(key, deep=True) for key in own]
        if len(set(keys)) < len(keys):
            twice = next(key for key in keys if keys.count(key) > 1)
            raise yaml.constructor.ConstructorError(None, None, f"{twice!r} twice", node.start_mark)
        return dict(found)


def load_yaml(where: Path | str, text: str, loader: type[StrictLoader] = StrictLoader) -> Any:
    """Return the values of a YAML text; ValueError in one line, with `where` it stands, for anything else."""
    if len(text) > MAX_TEXT:
        raise ValueError(f"{where}: expected YAML of at most {MAX_TEXT} characters, found {len(text)}")
    try:
        _check_events(text)
        return yaml.load(text, Loader=loader)
    except (yaml.YAMLError, ValueError) as error:
        raise ValueError(f"{where}: expected YAML, found {' '.join(str(error).split())[:300]}") from None


def _check_events(text: str) -> None:
    sizes: dict[str, tuple[int, int]] = {}  # values and levels of what has an anchor
    opened: list[tuple[str | None, list[int]]] = [(None, [0, 0])]  # anchor; values and levels so far
    repeated = 0
    for event in yaml.parse(text, Loader=Base):
        line, size = event.start_mark.line + 1, (1, 0)
        if isinstance(event, yaml.CollectionStartEvent):
            opened.append((event.anchor, [1, 0]))
            _check_depth(len(opened) - 1, line)
            continue
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                raise ValueError(f"line {line}: an alias (*{event.anchor}) of nothing that is whole before it")
            size = sizes[event.anchor]
            _check_depth(len(opened) - 1 + size[1], line)
            repeated += size[0]
            if repeated > MAX_REPEATED:
                raise ValueError(f"line {line}: aliases that stand for more than {MAX_REPEATED} values")
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, (values, levels) = opened.pop()
            size = values, levels + 1
            sizes |= {anchor: size} if anchor else {}
        elif isinstance(event, yaml.ScalarEvent):
            if not event.style and len(event.value) > MAX_WORD:
                raise ValueError(f"line {line}: a word of {len(event.value)} characters")
            sizes |= {event.anchor: size} if event.anchor else {}
        else:
            continue
        inside = opened[-1][1]
        inside[0], inside[1] = inside[0] + size[0], max(inside[1], size[1])


def _check_depth(depth: int, line: int) -> None:
    if depth > MAX_DEPTH:
        raise ValueError(f"line {line}: more than {MAX_DEPTH} levels")
