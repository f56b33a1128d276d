"""Fields of calibration files: read, checked, and told in one line with place, expected and found where wrong."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal, InvalidOperation
from typing import Any

import numpy as np

from sphere_nav.geometry.cameras.camera import MAX_SIDE
from sphere_nav.geometry.se3 import SE3

ROTATION_TOLERANCE = 1e-4  # files are written with full precision; a hand's four digits still pass
MAX_FILE_BYTES = 1 << 20  # a calibration takes some kilobytes
MAX_NUMBER = 1e15  # of any length, angle, coefficient or variance that makes sense
MAX_DIGITS = 64  # characters of a number
MAX_SECONDS = 2**31  # what a ROS stamp holds

_REPR = reprlib.Repr()
_REPR.maxstring = _REPR.maxother = _REPR.maxlong = 60


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


def size(found: Any, where: str) -> int:
    """Return a number of pixels."""
    if isinstance(found, bool) or not isinstance(found, int) or not 1 <= found <= MAX_SIDE:
        raise ValueError(f"{where}: expected a positive number of pixels, at most {MAX_SIDE}, found {short(found)}")
    return found


def pose(found: Any, where: str) -> SE3:
    """Return the motion of 4 rows of 4 numbers, a rotation within `ROTATION_TOLERANCE`."""
    if not isinstance(found, list) or len(found) != 4:
        raise ValueError(f"{where}: expected 4 rows of 4 numbers, found {short(found)}")
    matrix = np.array([numbers(row, where, 4) for row in found])
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
    if isinstance(found, int) and found.bit_length() > MAX_DIGITS * 4:
        return f"an integer of {found.bit_length()} bits"  # Python does not write those of more than 4300 digits
    text = " ".join(_REPR.repr(found).split())
    return text if len(text) <= 60 else text[:57] + "..."
