"""The modules of the checkout and the tests of each, by the mirror of the tree and by who imports whom."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

LIBRARY = "sphere_nav"  # its rooms count as packages
PARAMETER_TESTS = ("test/architecture/test_params.py", "test/config/test_yaml_matches_params.py")  # of every params.py
COMMANDS = {"sphere_nav_tools/offline": "sphere_nav_tools/cli"}  # what the commands do is tested through them, too
NEAR = 1  # tests at this distance of imports from a module, or nearer, run first


class Tree:
    """The checkout: its packages and modules, who imports whom, and the tests of each module."""

    def __init__(self, root: Path) -> None:
        body = ast.parse((root / "setup.py").read_text(encoding="utf-8")).body
        given = {ast.unparse(node.targets[0]): node.value for node in body if isinstance(node, ast.Assign)}
        self.root = root
        self.packages: tuple[str, ...] = ast.literal_eval(given["PACKAGES"])
        self.executables: dict[str, str] = ast.literal_eval(given["EXECUTABLES"])
        product = [path for name in self.packages for path in (root / name).rglob("*.py")]
        self.modules = sorted(PurePosixPath(path.relative_to(root)) for path in product)
        self.tests = sorted(PurePosixPath(path.relative_to(root)) for path in (root / "test").rglob("*.py"))
        self._trees = {path: ast.parse((root / path).read_text("utf-8")) for path in (*self.modules, *self.tests)}
        self._paths = {dotted(path): path for path in self._trees}
        self._importers: dict[PurePosixPath, set[PurePosixPath]] = {}
        for path in self._trees:
            for imported in self._imports(path):
                self._importers.setdefault(imported, set()).add(path)

    def texts(self) -> Iterator[tuple[PurePosixPath, bytes, ast.Module]]:
        """Yield the modules that are more than an index, with their text and syntax tree."""
        for path in self.modules:
            if not self._is_index(path):
                yield path, (self.root / path).read_bytes(), self._trees[path]

    def tests_of(self, path: PurePosixPath, line: str = "") -> tuple[list[str], list[str]]:
        """Return the test files of a module's package: those near to the module, and the others, nearest first.

        Near to a constant, whose line may be given, are also the tests of the modules that import it.
        """
        package = PurePosixPath(package_of(path))
        folder = "test" / package
        folders = [folder, *("test" / PurePosixPath(name) for name in [COMMANDS.get(str(package))] if name)]
        tests = [test for test in self.tests if any(map(test.is_relative_to, folders))]
        if str(package) == LIBRARY:
            tests = [test for test in tests if test.parent == folder]
        if "ros" in path.parts or path.name.endswith("node.py"):
            prefix = f"{dotted(package)}."
            nodes = [package.name, *(name for name, module in self.executables.items() if module.startswith(prefix))]
            starts = tuple(f"test_{name}" for name in nodes)
            tests += [test for test in self.tests if test.parts[1] == "nodes" and test.name.startswith(starts)]
        starts = {path, *self._users(path, line)}
        distances = self._distances(starts)
        if path.stem.endswith("params"):
            elsewhere = [test for test in self.tests if str(test) in PARAMETER_TESTS]
            tests += elsewhere
            distances |= dict.fromkeys(elsewhere, 0)
        distances |= {"test" / start.parent / f"test_{start.stem.strip('_')}.py": 0 for start in starts}
        files = [test for test in tests if test.name.startswith("test_")]
        ranks = sorted((distances.get(test, len(self._trees)), str(test)) for test in files)
        return [test for rank, test in ranks if rank <= NEAR], [test for rank, test in ranks if rank > NEAR]

    def _users(self, path: PurePosixPath, line: str) -> set[PurePosixPath]:
        """Return the modules that import what a line of constants gives a value to."""
        names = re.findall(r"\b[A-Z][A-Z0-9_]*\b", line.partition("=")[0]) if path.stem == "constants" else []
        wanted = {f"{dotted(path)}.{name}" for name in names}
        return {user for user in self.modules if wanted & self._imported(user)} if wanted else set()

    def _distances(self, paths: set[PurePosixPath]) -> dict[PurePosixPath, int]:
        """Return by how many imports each file is away from modules."""
        found, last = dict.fromkeys(paths, 0), sorted(paths)
        while last:
            news = {importer for item in last for importer in self._importers.get(item, ())} - found.keys()
            found |= dict.fromkeys(news, found[last[0]] + 1)
            last = sorted(news)
        return found

    def _imported(self, path: PurePosixPath) -> set[str]:
        """Return the dotted names that a file imports."""
        names = set()
        for node in ast.walk(self._trees[path]):
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                names |= {f"{node.module}.{alias.name}" for alias in node.names}
        return names

    def _imports(self, path: PurePosixPath) -> set[PurePosixPath]:
        """Return our files that one imports, through indices; a test also depends on the conftest.py above it."""
        found = {self._resolve(name) for name in self._imported(path)}
        if path.parts[0] == "test":
            found |= {folder / "conftest.py" for folder in path.parents if folder != PurePosixPath("test")}
        return {item for item in found if item in self._trees} - {path}

    def _resolve(self, name: str) -> PurePosixPath | None:
        """Return the file in which a dotted name is defined."""
        if name in self._paths or "." not in name:
            return self._paths.get(name)
        module, _, last = name.rpartition(".")
        index = self._paths.get(module)
        if index and self._is_index(index):
            for node in self._trees[index].body:
                if isinstance(node, ast.ImportFrom) and any((item.asname or item.name) == last for item in node.names):
                    return self._resolve(f"{node.module}.{last}")
        return index

    def _is_index(self, path: PurePosixPath) -> bool:
        """Whether a file only gathers names."""
        kinds = ast.FunctionDef | ast.ClassDef
        return path.name == "__init__.py" and not any(isinstance(node, kinds) for node in self._trees[path].body)


def dotted(path: PurePosixPath) -> str:
    """Return the name that a file is imported by; helpers of tests are imported from test/."""
    parts = path.with_suffix("").parts
    return ".".join(parts[parts[0] == "test" : len(parts) - (parts[-1] == "__init__")])


def package_of(path: PurePosixPath) -> str:
    """Return the package that a module belongs to; of the library its room."""
    return "/".join(path.parts[: 2 if path.parts[0] == LIBRARY and len(path.parts) > 2 else 1])
