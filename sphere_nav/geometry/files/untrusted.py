"""Files from outside: only regular ones, up to a size; YAML without surprises; fields checked, and told in one line.

A FIFO or a device would block for ever. In YAML no key stands twice; size, depth and aliases are bounded before
anything is built. A wrong field is told with its place, what was expected and what was found.
"""

from __future__ import annotations

import json
import math
import os
import reprlib
import stat
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, fields
from decimal import Decimal, InvalidOperation
from functools import cache
from io import BufferedReader
from pathlib import Path
from tokenize import TokenError
from types import UnionType
from typing import Any, TypeAlias, get_args, get_origin, get_type_hints

import numpy as np
import yaml

from sphere_nav.geometry.arrays import Size
from sphere_nav.geometry.se3 import SE3

AnyPath: TypeAlias = str | os.PathLike[str]
MAX_TABLE_BYTES = 64 << 20  # of numbers as text: half a million poses
MAX_ARRAY_BYTES = 1 << 32
NPY_MAGIC = b"\x93NUMPY"
LIMITS = {  # of what comes in a file or a message: more is refused before anything is allocated
    "image file": 1 << 28,  # bytes
    "cloud": 1 << 28,  # bytes of a message
    "sphere": 1 << 25,  # pixels: 8192 x 4096
    "features": 100_000,  # of a key sphere
    "bag": 1 << 50,  # bytes of a file: any that a disk holds
    "routes": 256 << 20,  # bytes of a network: 10 km are about 6 MB
}


@contextmanager
def told_at(where: object, kind: type[ValueError] = ValueError) -> Iterator[None]:
    """A ValueError of what is done within says where, and is of that kind."""
    try:
        yield
    except ValueError as error:
        raise kind(f"{where}: {error}") from None


def open_file(path: AnyPath, what: str, max_bytes: int) -> BufferedReader:
    """Open a regular file for reading; ValueError in one line where it is none, or larger than `max_bytes`.

    `what` names the kind of file that was expected. What is checked is what is opened, also behind a link.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (FileNotFoundError, NotADirectoryError):
        raise ValueError(f"{path}: expected a {what}, found no such file") from None
    try:
        _check(os.fstat(descriptor), path, what, max_bytes)
    except ValueError:
        os.close(descriptor)
        raise
    return os.fdopen(descriptor, "rb")


def read_bytes(path: AnyPath, what: str, max_bytes: int) -> bytes:
    """Return the bytes of a regular file; errors as of `open_file`."""
    with open_file(path, what, max_bytes) as file:
        size = os.fstat(file.fileno()).st_size
        return file.read(size) or b""  # takes memory for what is asked for; None of a file of /proc that would wait


def read_text(path: AnyPath, what: str, max_bytes: int = MAX_TABLE_BYTES, *, errors: str = "strict") -> str:
    """Return the text (UTF-8) of a regular file with LF for every line end; errors as of `open_file`.

    `errors` = "replace" reads on where a remark is in another encoding.
    """
    try:
        text = read_bytes(path, what, max_bytes).decode("utf-8-sig", errors)
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: expected text of a {what}, found {printable(str(error))}") from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_npy(path: AnyPath, what: str) -> Any:
    """Return the array of a .npy, mapped into memory; ValueError in one line for any other file."""
    with open_file(path, what, MAX_ARRAY_BYTES) as file:
        if file.read(len(NPY_MAGIC)) != NPY_MAGIC:  # np.load opens zip archives, too
            raise ValueError(f"{path}: expected an {what}, found a file that is none")
    try:
        return np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, EOFError, OSError, OverflowError, TypeError, SyntaxError, TokenError) as error:  # of its header
        text = printable(str(error))[:200]
        raise ValueError(f"{path}: expected an {what}, found a file that is none ({text})") from None


def load_json(where: object, text: str) -> Any:
    """Return the values of a JSON text; ValueError in one line, with `where` it stands, for anything else."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{where}: expected JSON, found {printable(str(error))[:200]}") from None


def path_below(folder: Path, name: str, what: str) -> Path:
    """Return the path of `name` in a folder, links followed; ValueError unless it lies below that."""
    root = folder.resolve()
    path = (root / name).resolve()
    if not name or path == root or not path.is_relative_to(root):
        raise ValueError(f"path: expected {what} below {root}, found {short(name)}")
    return path


def printable(text: str) -> str:
    """Return a text in one line, with an escape in place of each character that a terminal would obey."""
    line = " ".join(text.split())
    return line if line.isprintable() else "".join(c if c.isprintable() else ascii(c)[1:-1] for c in line)


def _check(found: os.stat_result, path: AnyPath, what: str, max_bytes: int) -> None:
    mode = found.st_mode
    if not stat.S_ISREG(mode):
        kind = "a folder" if stat.S_ISDIR(mode) else "a FIFO" if stat.S_ISFIFO(mode) else "no regular file"
        raise ValueError(f"{path}: expected a {what}, found {kind}")
    if found.st_size > max_bytes:
        raise ValueError(f"{path}: expected a {what} of at most {max_bytes} bytes, found {found.st_size}")


MAX_DEPTH = 32
MAX_ALIASES = 64  # each stands for a part of the text, as none stands for another
MAX_WORD = 4096  # characters without quotes; the sexagesimal numbers of YAML 1.1 take time by the square of theirs

Base: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class StrictLoader(Base):  # type: ignore[misc]
    """Refuses a key that comes twice, which YAML would pass over."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        """Return the mapping of a node; ConstructorError where a key comes twice."""
        own = [key for key, _ in node.value if key.tag != "tag:yaml.org,2002:merge"]  # those it merges, it may override
        found = super().construct_mapping(node, deep=True)  # refuses keys that cannot be compared
        keys = [self.construct_object(key, deep=True) for key in own]
        if len(set(keys)) < len(keys):
            twice = next(key for key in keys if keys.count(key) > 1)
            raise yaml.constructor.ConstructorError(None, None, f"{twice!r} twice", node.start_mark)
        return dict(found)


def load_yaml(where: object, text: str) -> Any:
    """Return the values of a YAML text; ValueError in one line, with `where` it stands, for anything else."""
    if len(text) > MAX_FILE_BYTES:
        raise ValueError(f"{where}: expected YAML of at most {MAX_FILE_BYTES} characters, found {len(text)}")
    try:
        _check_events(text)
        return yaml.load(text, Loader=StrictLoader)
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        raise ValueError(f"{where}: expected YAML, found {printable(str(error))[:300]}") from None


def _check_events(text: str) -> None:
    """Refuse what the loader would take memory, time or the stack for."""
    opened: list[str | None] = []  # the anchors of the collections that are open
    num_aliases = 0
    for event in yaml.parse(text, Loader=Base):
        line = event.start_mark.line + 1
        if isinstance(event, yaml.CollectionStartEvent):
            opened.append(event.anchor)
            if len(opened) > MAX_DEPTH:
                raise ValueError(f"line {line}: more than {MAX_DEPTH} levels")
        elif isinstance(event, yaml.CollectionEndEvent):
            opened.pop()
        elif isinstance(event, yaml.AliasEvent):
            num_aliases += 1
            if any(opened):
                raise ValueError(f"line {line}: an alias (*{event.anchor}) in what has an anchor")
            if num_aliases > MAX_ALIASES:
                raise ValueError(f"line {line}: more than {MAX_ALIASES} aliases")
        elif isinstance(event, yaml.ScalarEvent) and not event.style and len(event.value) > MAX_WORD:
            raise ValueError(f"line {line}: a word of {len(event.value)} characters")


ROTATION_TOLERANCE = 1e-4  # files are written with full precision; a hand's four digits still pass
MAX_FILE_BYTES = 1 << 20  # a calibration takes some kilobytes
MAX_NUMBER = 1e15  # of any length, angle, coefficient or variance that makes sense
MAX_DIGITS = 64  # characters of a number
MAX_SECONDS = 2**31  # what a ROS stamp holds

MAX_SHOWN = 60  # characters of a value that is named in an error
_shown = reprlib.Repr()
_shown.maxstring = _shown.maxother = _shown.maxlong = MAX_SHOWN


def mapping(found: Any, where: str, fields: Sequence[str], optional: Sequence[str] = ()) -> Mapping[str, Any]:
    """Return a mapping that has these fields, and no other ones."""
    required(found, where, [field for field in fields if field not in optional])
    for field in found:
        if field not in fields:
            raise ValueError(f"{where}.{field}: expected only {', '.join(fields)}, found this field")
    values: Mapping[str, Any] = found
    return values


def required(found: Any, where: str, fields: Sequence[str]) -> Mapping[str, Any]:
    """Return a mapping that has these fields, perhaps among others."""
    if not isinstance(found, dict):
        raise ValueError(f"{where}: expected the fields {', '.join(fields)}, found {short(found)}")
    for field in fields:
        if field not in found:
            raise ValueError(f"{where}.{field}: expected a value, found none")
    return found


def number(found: Any, where: str) -> float:
    """Return a finite number within `MAX_NUMBER`; text such as `1e-05`, no number in YAML 1.1, is one."""
    try:
        if isinstance(found, bool) or not isinstance(found, int | float | str) or len(str(found)) > MAX_DIGITS:
            raise ValueError
        value = float(found)
    except (ValueError, OverflowError):
        value = math.nan
    if not abs(value) <= MAX_NUMBER:
        limit = f" up to {MAX_NUMBER:g}" if math.isfinite(value) else ""
        raise ValueError(f"{where}: expected a finite number{limit}, found {short(found)}")
    return value


def numbers(found: Any, where: str, count: int | None = None) -> tuple[float, ...]:
    """Return a list of finite numbers."""
    if not isinstance(found, list):
        raise ValueError(f"{where}: expected a list of numbers, found {short(found)}")
    if count is not None and len(found) != count:
        raise ValueError(f"{where}: expected {count} numbers, found {len(found)}")
    return tuple(number(value, where) for value in found)


_hints = cache(get_type_hints)  # looked up for each value of a long list


def read_as(kind: Any, found: Any, where: str) -> Any:
    """Return what a file holds as a value of a type; ValueError with the place of what does not fit.

    Types are float, int, str, bool, tuples, mappings of names, classes with typed fields (a mapping, of a NamedTuple a
    list), and any of them or None. Fields with a default may be missing; others may stand beside.
    """
    origin, parts = get_origin(kind), get_args(kind)
    if origin is UnionType:
        return None if found is None else read_as(parts[0], found, where)
    if kind is float:
        return number(found, where)
    if hasattr(kind, "__dataclass_fields__"):
        hints = _hints(kind)
        required(found, where, [field.name for field in fields(kind) if field.default is MISSING])
        given = {name: hints[name] for name in hints if name in found}
        return kind(**{name: read_as(part, found[name], f"{where}.{name}") for name, part in given.items()})
    plain: Any = list if origin is tuple or hasattr(kind, "_fields") else origin or kind
    if type(found) is not plain:
        raise ValueError(f"{where}: expected {plain.__name__}, found {short(found)}")
    if plain is dict:
        return {str(key): read_as(parts[1], value, f"{where}.{key}") for key, value in found.items()}
    if plain is not list:
        return found
    kinds = parts or tuple(_hints(kind).values())
    kinds = kinds[:1] * len(found) if kinds[-1] is ... else kinds
    if len(found) != len(kinds):
        raise ValueError(f"{where}: expected {len(kinds)} values, found {len(found)}")
    values = [read_as(part, found[place], f"{where}[{place}]") for place, part in enumerate(kinds)]
    return tuple(values) if origin else kind(*values)


def parse_stamp_ns(word: str, where: str) -> int:
    """Return seconds since 1970, written in decimal, as nanoseconds without loss; a float64 would not hold them."""
    try:
        seconds = Decimal(word if len(word) <= MAX_DIGITS else "nan")
    except InvalidOperation:
        seconds = Decimal("nan")
    if not seconds.is_finite():
        raise ValueError(f"{where}: expected a finite number, found {short(word)}")
    if not 0 <= seconds < MAX_SECONDS:
        hint = " (nanoseconds?)" if seconds > 0 else ""
        raise ValueError(f"{where}: expected seconds from 0 to 2^31, found {short(word)}{hint}")
    return int((seconds * 10**9).to_integral_value())


def choice(found: Any, where: str, names: Iterable[str]) -> str:
    """Return one of these names."""
    known = tuple(names)
    if not isinstance(found, str) or found not in known:
        raise ValueError(f"{where}: expected {', '.join(known)}, found {short(found)}")
    return found


def pose(found: Any, where: str) -> SE3:
    """Return the motion of 4 rows of 4 numbers, a rotation within `ROTATION_TOLERANCE`."""
    if not isinstance(found, list) or len(found) != 4:
        raise ValueError(f"{where}: expected 4 rows of 4 numbers, found {short(found)}")
    matrix = np.array([numbers(row, where, 4) for row in found])
    with told_at(where):
        return SE3.from_matrix(matrix, ROTATION_TOLERANCE)


def check_center(center: tuple[float, float], image_size: Size, where: str) -> None:
    """Raise ValueError where the principal point lies outside the image: intrinsics of another size."""
    (cx, cy), (width, height) = center, image_size
    if not (0 <= cx < width and 0 <= cy < height):
        expected = f"the centre inside the {width} x {height} image"
        raise ValueError(f"{where}: expected {expected}, found cx {cx}, cy {cy}: of another image size?")


def short(found: Any) -> str:
    """Return a value as text of one short line, whatever its size."""
    try:
        text = " ".join(_shown.repr(found).split())
    except ValueError:  # Python does not write such a number
        text = "a number of thousands of digits"
    return text if len(text) <= MAX_SHOWN else f"{text[: MAX_SHOWN - 3]}..."
