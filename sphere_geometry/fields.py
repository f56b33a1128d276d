"""Fields of calibration files: read, checked, and told in one line with place, expected and found where wrong."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from sphere_geometry.se3 import SE3

ROTATION_TOLERANCE = 1e-4  # files are written with full precision; a hand's four digits still pass
MAX_FILE_BYTES = 16 << 20  # a calibration takes some kilobytes

_REPR = reprlib.Repr()
_REPR.maxstring = _REPR.maxother = _REPR.maxlong = 60


class StrictLoader(yaml.SafeLoader):  # type: ignore[misc]
    """Refuses a key that comes twice, which YAML would pass over."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        """Return the mapping of a node; ConstructorError where a key comes twice."""
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        for key in keys:
            if keys.count(key) > 1:
                raise yaml.constructor.ConstructorError(None, None, f"{key!r} twice", node.start_mark)
        return dict(super().construct_mapping(node, deep))


def read_text(path: Path, what: str) -> str:
    """Return the text of a file; `what` names the kind of file that was expected."""
    if not path.is_file():
        raise ValueError(f"{path}: expected a {what}, found {'a folder' if path.is_dir() else 'no such file'}")
    if (num_bytes := path.stat().st_size) > MAX_FILE_BYTES:
        raise ValueError(f"{path}: expected a {what} of at most {MAX_FILE_BYTES} bytes, found {num_bytes}")
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: expected text, found {' '.join(str(error).split())}") from None


def load_yaml(path: Path, text: str, loader: type[StrictLoader] = StrictLoader) -> Any:
    """Return the values of a YAML text; ValueError in one line, with the file's name, where it is none."""
    try:
        return yaml.load(text, Loader=loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise ValueError(f"{path}: expected YAML, found {' '.join(str(error).split())}") from None


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
    """Return a finite number."""
    value = _parsed(found)
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise ValueError(f"{where}: expected a finite number, found {short(found)}")
    return float(value)


def numbers(found: Any, where: str, count: int | None = None) -> tuple[float, ...]:
    """Return a list of finite numbers."""
    if not isinstance(found, list):
        raise ValueError(f"{where}: expected a list of numbers, found {short(found)}")
    if count is not None and len(found) != count:
        raise ValueError(f"{where}: expected {count} numbers, found {len(found)}")
    return tuple(number(value, where) for value in found)


def size(found: Any, where: str) -> int:
    """Return a number of pixels."""
    if isinstance(found, bool) or not isinstance(found, int) or found < 1:
        raise ValueError(f"{where}: expected a positive number of pixels, found {short(found)}")
    return found


def pose(found: Any, where: str) -> SE3:
    """Return the motion of 4 rows of 4 numbers, a rotation within `ROTATION_TOLERANCE`."""
    rows = [[_parsed(value) for value in row] if isinstance(row, list) else row for row in _as_list(found)]
    try:
        matrix = np.array(rows, dtype=np.float64)
    except (ValueError, TypeError):
        raise ValueError(f"{where}: expected 4 rows of 4 numbers, found {short(found)}") from None
    if matrix.shape != (4, 4):
        raise ValueError(f"{where}: expected 4 rows of 4 numbers, found shape {matrix.shape}")
    try:
        return SE3.from_matrix(matrix, ROTATION_TOLERANCE)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


def check_centre(centre: tuple[float, float], image_size: tuple[int, int], where: str) -> None:
    """Raise ValueError where the principal point lies outside the image: intrinsics of another size."""
    (cx, cy), (width, height) = centre, image_size
    if not (0 <= cx < width and 0 <= cy < height):
        expected = f"the centre inside the {width} x {height} image"
        raise ValueError(f"{where}: expected {expected}, found cx {cx}, cy {cy}: of another image size?")


def short(found: Any) -> str:
    """Return a value as text of one short line, whatever its size."""
    text = " ".join(_REPR.repr(found).split())
    return text if len(text) <= 60 else text[:57] + "..."


def _as_list(found: Any) -> list[Any]:
    return found if isinstance(found, list) else [found]


def _parsed(value: Any) -> Any:
    """Return text such as `1e-05`, which YAML 1.1 does not take for a number, as the number it is."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value
