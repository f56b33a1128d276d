"""What is left of the calibration of a rectified pair: where the right image has a point beside where it should.

Rows: points of both images must lie in the same row; a polynomial of the tangents (x, y) of the right pixel is fitted
to the disagreement, robustly. Disparity: its offset, bow (by x^2) and what is left of the lenses cannot be seen in a
pair, but make a point's range disagree with itself while the camera moves; `track_fit.py` finds them from a drive.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from sphere_mapping.acquisition.constants import (
    CORNER_PX,
    CORNERS,
    FIELD_FLOOR_PX,
    FIELD_PRIOR_PX,
    FIT_STEPS,
    FLOW,
    MAX_ROWS_APART,
    MIN_MATCHES,
)
from sphere_nav.estimation.least_squares import cauchy_weights, gate, squared_mahalanobis
from sphere_nav.geometry import Pinhole
from sphere_nav.geometry.arrays import Array, Bytes, Flags

NUM_ROWS, NUM_COLUMNS = 6, 8  # coefficients of both polynomials
NUM_BOW = 2  # of the columns' ones: offset and bow


@dataclass(frozen=True)
class StereoField:
    """Pixels by which the right image is off at tangents x, y of its pixels: dv by rows, du by columns.

    rows: 1, x, y, x^2, x y, y^2. columns: 1, x^2, x, y, x y, y^2, x^3, x^4, or the first of these; disparity is
    measured too small by du.
    """

    rows: tuple[float, ...] = (0.0,) * NUM_ROWS
    columns: tuple[float, ...] = (0.0,) * NUM_BOW

    def shift(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return du, dv in px: what belongs at the pixel of tangents x, y is found that much farther right and down."""
        columns = basis_of_columns(x, y)[..., : len(self.columns)] @ np.array(self.columns)
        return columns, basis_of_rows(x, y) @ np.array(self.rows)

    @property
    def is_nothing(self) -> bool:
        """Whether nothing is corrected."""
        return not any(self.rows) and not any(self.columns)


@dataclass(frozen=True, eq=False)
class RowFit:
    """Coefficients (6,) and their covariance; how far rows disagree before and after, median px; points compared."""

    rows: Array
    covariance: Array
    before_px: float
    after_px: float
    num_points: int

    @property
    def is_significant(self) -> bool:
        """Whether a correction is better than none."""
        return squared_mahalanobis(self.rows, self.covariance) > gate(NUM_ROWS)


def basis_of_rows(x: Array, y: Array) -> Array:
    """Return (..., 6)."""
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)


def basis_of_columns(x: Array, y: Array) -> Array:
    """Return (..., 8): offset and bow first."""
    return np.stack([np.ones_like(x), x * x, x, y, x * y, y * y, x**3, x**4], axis=-1)


def slopes_of_columns(x: Array, y: Array) -> tuple[Array, Array]:
    """Return the derivatives (..., 8) of `basis_of_columns` by x and by y."""
    none, one = np.zeros_like(x), np.ones_like(x)
    by_x = np.stack([none, 2 * x, one, none, y, none, 3 * x * x, 4 * x**3], axis=-1)
    return by_x, np.stack([none, none, none, one, x, 2 * y, none, none], axis=-1)


def tangents(camera: Pinhole, pixels: Array) -> tuple[Array, Array]:
    """Return x, y of pixels (..., 2) of a rectified image."""
    return (pixels[..., 0] - camera.cx) / camera.fx, (pixels[..., 1] - camera.cy) / camera.fy


def corners_of(image: Bytes) -> Array:
    """Return corners (N, 2) of a grey image."""
    found = cv2.goodFeaturesToTrack(image, **CORNERS)
    return np.zeros((0, 2)) if found is None else found.reshape(-1, 2).astype(np.float64)


def follow(first: Bytes, second: Bytes, points: Array) -> tuple[Array, Flags]:
    """Return where points (N, 2) of one grey image are in another, and whether they are found back from there."""
    if not len(points):
        return points, np.zeros(0, np.bool_)
    start = points.astype(np.float32).reshape(-1, 1, 2)
    there, seen, _ = cv2.calcOpticalFlowPyrLK(first, second, start, None, **FLOW)
    back, seen_back, _ = cv2.calcOpticalFlowPyrLK(second, first, there, None, **FLOW)
    is_back = np.linalg.norm((back - start)[:, 0], axis=1) < CORNER_PX
    return there[:, 0].astype(np.float64), is_back & (seen[:, 0] > 0) & (seen_back[:, 0] > 0)


def match_corners(left: Bytes, right: Bytes) -> tuple[Array, Array]:
    """Return pixels (N, 2) of both grey images of a pair that show the same."""
    points = corners_of(left)
    there, is_found = follow(left, right, points)
    apart = there - points
    fits = is_found & (np.abs(apart[:, 1]) < MAX_ROWS_APART) & (apart[:, 0] < MAX_ROWS_APART)
    return points[fits], there[fits]


def fit_rows(camera: Pinhole, left: Array, right: Array) -> RowFit | None:
    """Return the polynomial of the rows of matches (N, 2), None where there are too few."""
    if len(left) < MIN_MATCHES:
        return None
    values = right[:, 1] - left[:, 1]
    A = basis_of_rows(*tangents(camera, right))
    prior = np.eye(NUM_ROWS) / FIELD_PRIOR_PX**2
    rows: Array = np.zeros(NUM_ROWS)
    weights: Array = np.ones(len(values))
    scale, normal = 8 * CORNER_PX, prior
    for _ in range(FIT_STEPS):
        weights = cauchy_weights(np.square((values - A @ rows) / scale))
        normal = (A * weights[:, None]).T @ A / CORNER_PX**2 + prior
        rows = np.asarray(np.linalg.solve(normal, (A * weights[:, None]).T @ values / CORNER_PX**2), np.float64)
        scale = max(scale / 2, CORNER_PX)
    left_over = values - A @ rows
    variance = np.sum(weights * left_over**2) / max(np.sum(weights) - NUM_ROWS, 1.0)
    covariance = np.asarray(np.linalg.inv(normal) * (max(variance, 1e-6) / CORNER_PX**2), np.float64)
    covariance = covariance + FIELD_FLOOR_PX**2 * np.eye(NUM_ROWS)
    return RowFit(rows, covariance, float(np.median(np.abs(values))), float(np.median(np.abs(left_over))), len(values))
