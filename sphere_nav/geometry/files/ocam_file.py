"""The text file of Scaramuzza's OCamCalib (calib_results.txt): one camera, a polynomial from pixel to ray.

Its axes are those of an image matrix: x along rows, y along columns, and z away from the scene.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.foreign_cameras import WIDEST_DEG, ForeignRig
from sphere_nav.geometry.files.lens_fit import fit_lens, grid_of
from sphere_nav.geometry.files.untrusted import MAX_FILE_BYTES, number, read_text
from sphere_nav.geometry.se3 import SE3

NUM_LINES = 5  # polynomial, inverse polynomial, centre, affine part, size
MAX_DEGREE = 20


def is_ocam(path: Path) -> bool:
    """Whether a file has the lines of OCamCalib's."""
    return _is_complete(_lines(path))


def read_ocam(path: Path) -> ForeignRig:
    """Return the camera as the nearest of ours; ValueError in one line."""
    lines = _lines(path)
    if not _is_complete(lines):
        told = "polynomial, inverse polynomial, centre, c d e and size"
        raise ValueError(f"{path}: expected {told}, found {len(lines)} lines")
    values = [[number(word, str(path)) for word in line] for line in lines]
    count, *polynomial = values[0]
    if count != len(polynomial) or not 2 <= count <= MAX_DEGREE:
        raise ValueError(f"{path}: polynomial: expected {count:.0f} coefficients, found {len(polynomial)}")
    height, width = (round(side) for side in values[4])
    size = (width, height)
    pixels = grid_of(size)
    rays = unproject(pixels, np.array(polynomial), values[2], values[3])
    is_within = rays[:, 2] > np.cos(np.radians(WIDEST_DEG)) * np.linalg.norm(rays, axis=1)
    if np.count_nonzero(is_within) < len(pixels) // 4:
        raise ValueError(f"{path}: polynomial: expected rays ahead of the camera, found hardly any")
    fit = fit_lens(rays[is_within], pixels[is_within], size, abs(polynomial[0]), str(path))
    return ForeignRig(("cam0",), (fit.camera,), (SE3.identity(),), fits=(fit,))


def unproject(pixels: Array, polynomial: Array, center: list[float], affine: list[float]) -> Array:
    """Return rays (N, 3) with optical axes of pixels (N, 2); centre (row, column), affine (c, d, e)."""
    c, d, e = affine
    row, column = pixels[:, 1] - center[0], pixels[:, 0] - center[1]
    determinant = c - d * e
    x, y = (row - d * column) / determinant, (-e * row + c * column) / determinant
    z = np.polynomial.polynomial.polyval(np.hypot(x, y), polynomial)
    return np.stack([y, x, -z], axis=1)


def _is_complete(lines: list[list[str]]) -> bool:
    return len(lines) == NUM_LINES and [len(line) for line in lines[2:]] == [2, 3, 2]


def _lines(path: Path) -> list[list[str]]:
    text = read_text(path, "calibration of OCamCalib", MAX_FILE_BYTES)
    return [line.split() for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
