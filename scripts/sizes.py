"""`python scripts/sizes.py [--write]`: what a reader of each package carries; ceilings.toml has what it may.

Nodes are those of the syntax tree without docstrings and imports. `--write` sets the ceilings to what is.
"""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
from collections import Counter
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).resolve().parents[1]
CEILINGS = ROOT / "scripts" / "ceilings.toml"
WHATS = ("nodes", "branches", "lines", "files", "names", "parameters", "constants")
OTHERS = {"test", "benchmarks", "scripts", "docs"}  # not installed
BRANCHES = (ast.If, ast.For, ast.While, ast.ExceptHandler, ast.IfExp, ast.comprehension, ast.Assert)
UNCOUNTED = (ast.Import, ast.ImportFrom, ast.alias, ast.Load, ast.Store, ast.arguments)
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def measure(text: str) -> Counter[str]:
    """Return what one module holds; constants are names in capitals with numbers, but for kernels and simulator."""
    tree = ast.parse(text)
    nodes = list(ast.walk(tree))
    kinds = Counter(map(type, nodes))
    told = [node for node in nodes if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None]
    found = Counter(lines=text.count("\n"), files=1)
    found["nodes"] = len(nodes) - sum(map(kinds.__getitem__, UNCOUNTED)) - sum(1 + (len(n.body) > 1) for n in told)
    found["branches"] = sum(map(kinds.__getitem__, BRANCHES))
    found["branches"] += sum(len(node.values) - 1 for node in nodes if isinstance(node, ast.BoolOp))
    found["parameters"] = sum(isinstance(n, ast.Call) and getattr(n.func, "id", "") == "param" for n in nodes)
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found["names"] += not node.name.startswith("_")
        elif isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = [item.id for target in targets for item in ast.walk(target) if isinstance(item, ast.Name)]
            values = [item.value for item in ast.walk(node.value) if isinstance(item, ast.Constant)]
            found["names"] += sum(not name.startswith("_") for name in names)
            found["constants"] += any(type(value) in (int, float) for value in values) * sum(map(str.isupper, names))
    return found


def sizes() -> dict[str, Counter[str]]:
    """Return the sizes of each package, of the library's rooms, and of the `product`: all that is installed."""
    listed = subprocess.run(["git", "ls-files", "*.py"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    found: dict[str, Counter[str]] = {}
    for path in map(PurePosixPath, listed.splitlines()):
        if len(path.parts) > 1 and (ROOT / path).is_file():
            one = measure((ROOT / path).read_text(encoding="utf-8"))
            one["constants"] *= path.name != "kernels.py" and path.parts[0] != "cycab_sim"
            package = "/".join(path.parts[: 1 + (path.parts[0] == "sphere_nav" and len(path.parts) > 2)])
            for name in (package, *(["product"] if path.parts[0] not in OTHERS else [])):
                found.setdefault(name, Counter()).update(one)
    return dict(sorted(found.items(), key=lambda item: (item[0] == "product", item[0])))


def find_excesses(found: dict[str, Counter[str]], ceilings: dict[str, dict[str, int]]) -> list[str]:
    """Return a line for all that is above its ceiling, and for every package that has none."""
    rows = [(name, what, ceilings.get(name, {}).get(what, 0), found[name][what]) for name in found for what in WHATS]
    return [f"{name}: {what}: expected at most {most}, found {size}" for name, what, most, size in rows if size > most]


def main() -> str:
    """Print the sizes; return what is above its ceiling."""
    found = sizes()
    sys.stdout.write(" " * 26 + "".join(f"{what:>11}" for what in WHATS) + "\n")
    sys.stdout.writelines(f"{n:26}" + "".join(f"{one[w]:>11}" for w in WHATS) + "\n" for n, one in found.items())
    if "--write" in sys.argv[1:]:
        rows = [f"[{name!r}]\n" + "".join(f"{what} = {one[what]}\n" for what in WHATS) for name, one in found.items()]
        CEILINGS.write_text("\n".join(rows), encoding="utf-8")
    return "\n".join(find_excesses(found, tomllib.loads(CEILINGS.read_text(encoding="utf-8"))))


if __name__ == "__main__":
    sys.exit(main() or 0)
