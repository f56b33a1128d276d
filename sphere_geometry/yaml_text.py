"""YAML from outside: no aliases, no merge keys, no key twice, bounded in size and depth before anything is built."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

MAX_TEXT = 1 << 20  # characters
MAX_DEPTH = 32
MAX_WORD = 4096  # characters without quotes; the sexagesimal numbers of YAML 1.1 take time by the square of theirs

Base: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class StrictLoader(Base):  # type: ignore[misc]
    """Refuses a key that comes twice, which YAML would pass over."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        """Return the mapping of a node; ConstructorError where a key comes twice."""
        found = super().construct_mapping(node, deep=True)
        if len(found) < len(node.value):
            keys = [self.construct_object(key, deep=True) for key, _ in node.value]
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
    depth = 0
    for event in yaml.parse(text, Loader=Base):
        line = event.start_mark.line + 1
        if isinstance(event, yaml.AliasEvent):
            raise ValueError(f"line {line}: an alias (*{event.anchor}), which is not read")
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > MAX_DEPTH:
                raise ValueError(f"line {line}: more than {MAX_DEPTH} levels")
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        elif isinstance(event, yaml.ScalarEvent) and not event.style:
            if len(event.value) > MAX_WORD:
                raise ValueError(f"line {line}: a word of {len(event.value)} characters")
            if event.value == "<<":
                raise ValueError(f"line {line}: a merge key (<<), which is not read")
