"""The text file of Scaramuzza's OCamCalib (calib_results.txt): one camera, a polynomial from pixel to ray.

Its axes are those of an image matrix: x along rows, y along columns, and z away from the scene.
"""

from __future__ import annotations

from pathlib import Path

from sphere_nav.geometry.cameras.ocam import OCam
from sphere_nav.geometry.files.foreign_cameras import ForeignRig
from sphere_nav.geometry.files.untrusted import MAX_FILE_BYTES, number, read_text, told_at
from sphere_nav.geometry.se3 import SE3

NUM_LINES = 5  # polynomial, inverse polynomial, centre, affine part, size
MAX_DEGREE = 20


def is_ocam(path: Path) -> bool:
    """Whether a file has the lines of OCamCalib's."""
    return _is_complete(_lines(path))


def read_ocam(path: Path) -> ForeignRig:
    """Return the camera; ValueError in one line."""
    lines = _lines(path)
    if not _is_complete(lines):
        told = "polynomial, inverse polynomial, centre, c d e and size"
        raise ValueError(f"{path}: expected {told}, found {len(lines)} lines")
    values = [[number(word, str(path)) for word in line] for line in lines]
    count, *polynomial = values[0]
    if count != len(polynomial) or not 2 <= count <= MAX_DEGREE:
        raise ValueError(f"{path}: polynomial: expected {count:.0f} coefficients, found {len(polynomial)}")
    height, width = (round(side) for side in values[4])
    (row, column), (c, d, e) = values[2], values[3]
    with told_at(path):
        camera = OCam(width, height, column, row, tuple(-value for value in polynomial), c, d, e)
    return ForeignRig(("cam0",), (camera,), (SE3.identity(),))


def _is_complete(lines: list[list[str]]) -> bool:
    return len(lines) == NUM_LINES and [len(line) for line in lines[2:]] == [2, 3, 2]


def _lines(path: Path) -> list[list[str]]:
    text = read_text(path, "calibration of OCamCalib", MAX_FILE_BYTES)
    return [line.split() for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
