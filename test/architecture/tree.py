"""The project's own modules, in the checkout and as they are installed."""

import ast
import importlib.util
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
DIVIDED = ("sphere_nav", "sphere_nav_tools")  # ground and roof: the packages that are divided into rooms


def setup_constants() -> dict[str, Any]:
    """Return the constants of setup.py by name: what is installed stands there, once."""
    body = ast.parse((ROOT / "setup.py").read_text(encoding="utf-8")).body
    assignments = [node for node in body if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)]
    return {node.targets[0].id: ast.literal_eval(node.value) for node in assignments}


PACKAGES: tuple[str, ...] = setup_constants()["PACKAGES"]
EXECUTABLES: dict[str, str] = setup_constants()["EXECUTABLES"]
MODULES = sorted(path.relative_to(ROOT) for name in PACKAGES for path in (ROOT / name).rglob("*.py"))


@cache
def parse(module: Path) -> ast.Module:
    return ast.parse((ROOT / module).read_text(encoding="utf-8"))


def modules_with(text: str) -> Iterator[Path]:
    """Yield the modules that a text occurs in: to parse all takes seconds, which each worker would spend to collect."""
    yield from (module for module in MODULES if text in (ROOT / module).read_text(encoding="utf-8"))


def imports(module: Path, *, is_at_load: bool = False) -> Iterator[str]:
    """Yield the dotted name of everything a module imports, `from a.b import c` as `a.b.c`; or only at load."""
    for node in parse(module).body if is_at_load else ast.walk(parse(module)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}:{node.lineno}: relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def dotted(module: Path) -> str:
    return ".".join(module.with_suffix("").parts).removesuffix(".__init__")


def room(name: str) -> str:
    """Return the room that a module lies in, by its dotted name: a package, or a folder of a divided one."""
    parts = name.split(".")
    return ".".join(parts[:2]) if parts[0] in DIVIDED else parts[0]


def is_shell(module: Path) -> bool:
    return "ros" in module.parts[:-1]


def installed(package: str) -> Path | None:
    """Return the folder that a package is imported from."""
    spec = importlib.util.find_spec(package)
    return Path(spec.origin).parent if spec and spec.origin else None


def differences() -> list[str]:
    """Return what the installation lacks or holds in another version than the checkout."""
    found = []
    for module in MODULES:
        folder = installed(module.parts[0])
        copy = folder.parent / module if folder else None
        if copy is None or not copy.is_file() or copy.read_bytes() != (ROOT / module).read_bytes():
            found.append(str(module))
    return found


def flatten(tree: dict[str, object], prefix: str = "") -> dict[str, object]:
    """Return the leaves of a tree of mappings, by dotted name."""
    values: dict[str, object] = {}
    for name, item in tree.items():
        values |= flatten(item, f"{prefix}{name}.") if isinstance(item, dict) else {prefix + name: item}
    return values


def for_all(items: Iterable[Any]) -> Callable[[Callable[[Any], None]], Callable[[], None]]:
    """Make the check of one item a test of all of them, which tells each that is refused."""

    def decorate(check: Callable[[Any], None]) -> Callable[[], None]:
        def test() -> None:
            refused = []
            for item in items:
                try:
                    check(item)
                except AssertionError as error:
                    refused.append(f"{item}: {error}")
            assert not refused, "\n".join(refused)

        return test

    return decorate
