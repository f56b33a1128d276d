"""Small faults in Python code, found by syntax tree and made by replacing one token or adding one: see `KINDS`.

What no test of a package could or should notice is left alone: texts, type hints, decorators, error and log messages,
options of a command line, enumerations, ranges and meanings of declared parameters.
"""

from __future__ import annotations

import ast
import random
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

Edit = tuple[int, int, str]  # begin and end in bytes of the file, what stands there instead

UNCHANGED_CALLS = {
    "add_argument",
    "add_parser",
    "debug",
    "info",
    "warning",
    "warn",
    "error",
    "exception",
    "log",
    "print",
}
UNCHANGED_CALLS |= {"TypeVar", "cast", "add_mutually_exclusive_group"}
UNCHANGED_FIELDS = {"annotation", "returns", "decorator_list", "bases"}
SYMMETRIC = {"min", "max", "minimum", "maximum", "hypot", "isclose", "allclose", "array_equal", "logical_and"}
SYMMETRIC |= {"logical_or", "fmin", "fmax", "multiply", "add", "gcd", "lcm", "samefile"}
UNLIKE = {"isinstance", "issubclass", "getattr", "hasattr", "setattr"}  # swapped, these fail wherever they run
UNLIKE |= {"array", "asarray", "ascontiguousarray", "astype", "frombuffer", "full", "zeros", "ones", "swapaxes"}
UNLIKE |= {"param"}  # its text and unit
ANGLES = {"radians", "degrees", "deg2rad", "rad2deg"}
EXTREMES = {"min": "max", "argmin": "argmax", "nanmin": "nanmax", "nanargmin": "nanargmax", "minimum": "maximum"}
EXTREMES |= {"fmin": "fmax", "amin": "amax"}
EXTREMES |= {new: old for old, new in EXTREMES.items()}
BOUNDS = {ast.Lt: ("<", "<=", ">"), ast.LtE: ("<=", "<", ">="), ast.Gt: (">", ">=", "<"), ast.GtE: (">=", ">", "<=")}
MANY = 10**6  # larger constants count nanoseconds
Sequences = (ast.List, ast.Tuple, ast.Set, ast.Dict, ast.ListComp, ast.JoinedStr)


@dataclass(frozen=True)
class Mutant:
    """One fault: where, which, and the source line (without its margin); begin and end are bytes of the file."""

    path: str
    line: int
    kind: str
    change: str
    text: str
    begin: int
    end: int
    new: str

    @property
    def key(self) -> tuple[str, str, str]:
        """What a mutant is known by when lines or files have moved."""
        return self.kind, self.change, self.text

    @property
    def where(self) -> str:
        """Place and kind, for a reader."""
        return f"{self.path}:{self.line}  {self.kind}"

    def distance(self, other: Mutant) -> tuple[bool, bool, int]:
        """Return how far away another mutant of the same key is: another folder, another name, bytes."""
        names = [mutant.path.rpartition("/")[2] for mutant in (self, other)]
        return self.path != other.path, names[0] != names[1], abs(self.begin - other.begin)


@dataclass
class Source:
    """One module, and what is known of the node that is looked at."""

    text: bytes
    constants: set[str]
    is_constant: bool = False  # within the value of a constant or a default
    parents: list[ast.AST] = field(default_factory=list)

    def __post_init__(self) -> None:
        lengths = [len(line) for line in self.text.splitlines(keepends=True)]
        self._starts = [sum(lengths[:k]) for k in range(len(lengths) + 1)]

    def begin(self, node: ast.expr) -> int:
        """Return the byte at which a node begins."""
        return self._starts[node.lineno - 1] + node.col_offset

    def end(self, node: ast.expr) -> int:
        """Return the byte behind a node."""
        return self._starts[(node.end_lineno or 0) - 1] + (node.end_col_offset or 0)

    def of(self, node: ast.expr) -> str:
        """Return the text of a node."""
        return self.text[self.begin(node) : self.end(node)].decode()

    def between(self, left: ast.expr, right: ast.expr, old: str, new: str) -> Iterator[Edit]:
        """Yield the change of an operator between two nodes; none where a comment could be meant."""
        gap = self.text[self.end(left) : self.begin(right)]
        if b"#" not in gap and gap.count(old.encode()) == 1:
            begin = self.end(left) + gap.index(old.encode())
            yield begin, begin + len(old), new

    def line_of(self, begin: int) -> int:
        """Return the number of the line that a byte is in."""
        return self.text.count(b"\n", 0, begin) + 1


def signs(source: Source, node: ast.AST) -> Iterator[Edit]:
    """A minus dropped, one added to a product, plus for minus."""
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield source.begin(node), source.begin(node) + 1, ""
    elif isinstance(node, ast.BinOp) and not is_text(node.left) and not is_text(node.right):
        if isinstance(node.op, ast.Mult):
            yield source.begin(node), source.begin(node), "-"
        elif isinstance(node.op, ast.Add | ast.Sub):
            yield from source.between(node.left, node.right, *("+-" if isinstance(node.op, ast.Add) else "-+"))
    elif isinstance(node, ast.AugAssign) and isinstance(node.op, ast.Add | ast.Sub) and not is_text(node.value):
        yield from source.between(node.target, node.value, *("+-" if isinstance(node.op, ast.Add) else "-+"))


def bounds(source: Source, node: ast.AST) -> Iterator[Edit]:
    """A bound that belongs to the other side, and a comparison turned round."""
    if isinstance(node, ast.Compare):
        sides = [node.left, *node.comparators]
        for left, operator, right in zip(sides, node.ops, sides[1:], strict=False):
            old, *others = BOUNDS.get(type(operator), ("",))
            for new in others:
                yield from source.between(left, right, old, new)


def units(source: Source, node: ast.AST) -> Iterator[Edit]:
    """A constant or a number in another unit, an angle that is not converted."""
    if isinstance(node, ast.Call) and name_of(node.func) in ANGLES and len(node.args) == 1:
        yield source.begin(node), source.end(node), f"({source.of(node.args[0])})"
    elif source.is_constant:
        return
    elif isinstance(node, ast.Name | ast.Attribute) and name_of(node) in source.constants:
        if isinstance(node.ctx, ast.Load):
            factor = "1e-9" if name_of(node).endswith("NS") else "1000"
            yield source.begin(node), source.end(node), f"({source.of(node)} * {factor})"
    elif isinstance(node, ast.Constant) and isinstance(source.parents[-1], ast.BinOp | ast.Compare | ast.Call):
        value, parent = number(node), source.parents[-1]
        is_power = isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Pow)
        if value and (isinstance(value, float) or abs(value) >= 1000) and not is_power:
            factor = "1e-9" if abs(value) >= MANY else "1000"
            yield source.begin(node), source.end(node), f"({source.of(node)} * {factor})"


def swaps(source: Source, node: ast.AST) -> Iterator[Edit]:
    """Two arguments side by side change places."""
    if isinstance(node, ast.Call) and name_of(node.func) not in SYMMETRIC | UNLIKE:
        for left, right in zip(node.args, node.args[1:], strict=False):
            if alike(left) and alike(left) == alike(right) and ast.dump(left) != ast.dump(right):
                gap = source.text[source.end(left) : source.begin(right)].decode()
                if gap.strip() == ",":  # parentheses and comments stay where they are
                    yield source.begin(left), source.end(right), source.of(right) + gap + source.of(left)


def checks(source: Source, node: ast.AST) -> Iterator[Edit]:
    """A check that never finds anything."""
    leaves = ast.Raise | ast.Return | ast.Continue
    if isinstance(node, ast.If) and len(node.body) <= 2 and isinstance(node.body[-1], leaves):
        yield source.begin(node.test), source.end(node.test), "False"


def constants(source: Source, node: ast.AST) -> Iterator[Edit]:
    """A number in a constant or a default twice as large."""
    if source.is_constant and isinstance(node, ast.Constant) and number(node):
        parent = source.parents[-1]
        is_exponent = (
            isinstance(parent, ast.BinOp) and isinstance(parent.op, ast.Pow | ast.LShift) and node is parent.right
        )
        if not is_exponent and not isinstance(parent, ast.Subscript):
            yield source.begin(node), source.end(node), repr(2 * number(node))


def booleans(source: Source, node: ast.AST) -> Iterator[Edit]:
    """One `and` for `or`, or the other way round."""
    if isinstance(node, ast.BoolOp):
        words = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        for left, right in zip(node.values, node.values[1:], strict=False):
            yield from source.between(left, right, *words)


def extremes(source: Source, node: ast.AST) -> Iterator[Edit]:
    """The smallest for the largest."""
    if isinstance(node, ast.Call) and name_of(node.func) in EXTREMES:
        name = name_of(node.func)
        yield source.end(node.func) - len(name), source.end(node.func), EXTREMES[name]


def negations(source: Source, node: ast.AST) -> Iterator[Edit]:
    """A `not` that is gone."""
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield source.begin(node), source.begin(node) + len("not "), ""
    elif isinstance(node, ast.Compare) and len(node.ops) == 1 and isinstance(node.ops[0], ast.IsNot | ast.NotIn):
        words = ("is not", "is") if isinstance(node.ops[0], ast.IsNot) else ("not in", "in")
        yield from source.between(node.left, node.comparators[0], *words)


KINDS: dict[str, Callable[[Source, ast.AST], Iterator[Edit]]] = {
    "sign": signs,
    "bound": bounds,
    "unit": units,
    "swap": swaps,
    "check": checks,
    "constant": constants,
    "boolean": booleans,
    "extreme": extremes,
    "negation": negations,
}


def mutants_of(text: bytes, path: str, names: set[str]) -> list[Mutant]:
    """Return every mutant of a module, `names` being the constants of the product that are numbers."""
    source = Source(text, names)
    found: dict[tuple[int, int, str], Mutant] = {}
    for node in nodes(source, ast.parse(text)):
        for kind, edits in KINDS.items():
            for begin, end, new in edits(source, node):
                line = source.line_of(begin)
                old = text[begin:end].decode()
                change = f"{flat(old)} -> {flat(new)}" if old and new else f"without {old}" if old else f"with {new}"
                row = text.splitlines()[line - 1].decode().strip()
                mutant = Mutant(path, line, kind, change, row, begin, end, new)
                found.setdefault((begin, end, new), mutant)
    return list(found.values())


def nodes(source: Source, node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes that may change, each with its parents in `source.parents`."""
    for name, value in ast.iter_fields(node):
        if name in UNCHANGED_FIELDS or (isinstance(node, ast.ClassDef) and name == "keywords"):
            continue
        was_constant = source.is_constant
        source.is_constant |= is_default(node, name, source.parents[-1] if source.parents else None)
        source.parents.append(node)
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not is_unchanged(child):
                yield child
                yield from nodes(source, child)
        source.parents.pop()
        source.is_constant = was_constant


def is_default(node: ast.AST, name: str, parent: ast.AST | None) -> bool:
    """Whether a field of a node is the value of a constant, or a default of an argument, field or parameter."""
    if isinstance(node, ast.Assign | ast.AnnAssign) and name == "value":
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        is_field = isinstance(node, ast.AnnAssign) and isinstance(parent, ast.ClassDef)
        return is_field or all(name_of(target).isupper() for target in targets)
    return isinstance(node, ast.arguments) and name in ("defaults", "kw_defaults")


def is_unchanged(node: ast.AST) -> bool:
    """Whether a node and all below it stay as they are."""
    if isinstance(node, ast.Raise | ast.Assert | ast.JoinedStr) or is_call(node, *UNCHANGED_CALLS):
        return True
    if isinstance(node, ast.FunctionDef):
        return node.name == "warm_up"
    if isinstance(node, ast.ClassDef):
        return any(name_of(base).endswith(("Enum", "Flag", "Protocol")) for base in node.bases)
    if isinstance(node, ast.If):
        return "TYPE_CHECKING" in ast.dump(node.test) or "__main__" in ast.dump(node.test)
    return isinstance(node, ast.keyword) and (node.arg in ("axis", "low", "high", "help", "stacklevel"))


def numeric_constants(trees: Iterable[ast.Module]) -> set[str]:
    """Return the names in capitals that are numbers wherever they are assigned."""
    numbers: set[str] = set()
    others: set[str] = set()
    for tree in trees:
        for node in ast.walk(tree):
            if isinstance(node, ast.Assign | ast.AnnAssign):
                for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                    if isinstance(target, ast.Name) and target.id.isupper():
                        (numbers if is_numeric(node.value) else others).add(target.id)
    return numbers - others


def is_numeric(node: ast.AST | None) -> bool:
    """Whether an expression is a number, as far as can be seen."""
    if isinstance(node, ast.BinOp):
        sides = (node.left, node.right)
        return any(map(is_numeric, sides)) and all(is_numeric(side) or name_of(side).isupper() for side in sides)
    if isinstance(node, ast.UnaryOp):
        return is_numeric(node.operand)
    return is_number(node) or is_call(node, *ANGLES, "sqrt", "log")


def number(node: ast.AST | None) -> float:
    """Return a number as written; 0 for anything else, which no fault changes either."""
    value = node.value if isinstance(node, ast.Constant) else 0
    return value if isinstance(value, int | float) and not isinstance(value, bool) else 0


def is_text(node: ast.AST) -> bool:
    """Whether a node is a text or a sequence, which has no sign."""
    is_literal = isinstance(node, ast.Constant) and not is_number(node)
    return is_literal or isinstance(node, Sequences) or is_call(node, "str")


def is_number(node: ast.AST | None) -> bool:
    """Whether a node is a number as written."""
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def alike(node: ast.expr) -> str:
    """Return a word for what may be swapped for what: a text never for a number, nothing for a function or *rest."""
    if isinstance(node, ast.Starred | ast.Lambda | ast.GeneratorExp):
        return ""
    is_string = isinstance(node, ast.Constant) and isinstance(node.value, str | bytes)
    return "text" if is_string or isinstance(node, ast.JoinedStr) else "value"


def is_call(node: ast.AST | None, *names: str) -> bool:
    """Whether a node calls a function or method of one of these names."""
    return isinstance(node, ast.Call) and name_of(node.func) in names


def name_of(node: ast.AST) -> str:
    """Return the last part of a name."""
    return node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""


def flat(text: str) -> str:
    """Return a text in one line."""
    return " ".join(text.split())


def apply(text: bytes, mutant: Mutant) -> bytes:
    """Return a module with its fault."""
    return text[: mutant.begin] + mutant.new.encode() + text[mutant.end :]


def draw(mutants: list[Mutant], count: int, rng: random.Random) -> list[Mutant]:
    """Return a sample, one of each kind in turn; a larger one begins with the smaller."""
    kinds = {kind: [mutant for mutant in mutants if mutant.kind == kind] for kind in KINDS}
    for items in kinds.values():
        rng.shuffle(items)
    found: list[Mutant] = []
    while any(kinds.values()) and len(found) < count:
        names = [kind for kind, items in kinds.items() if items]
        rng.shuffle(names)
        found += [kinds[kind].pop() for kind in names]
    return found[:count]
