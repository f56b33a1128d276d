"""The frame of a surveyor's file -> that of the map: metres, z up, near the origin.

Surveys come in metres, feet or millimetres, some drawing programs write kilometres or y up, and coordinates of a state
or of UTM are millions: float32 has steps of half a metre there. So a unit is found (as the file declares it, else by
the extent), the axis that the ground lies across, and a shift in whole hundreds of metres, which goes with the map as
its origin. Whatever is done is said in one line.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mcl_depth.constants import (
    GROUND_STEP,
    LARGE_EXTENT_M,
    LEAST_STANDING,
    MAX_COORDINATE_M,
    MAX_LONELY,
    MIN_POINTS,
    ORIGIN_STEP_M,
    SMALL_EXTENT,
    STRAY_RATIO,
    STRAY_SHARE,
    SURVEY_SAMPLES,
    UP_RATIO,
)
from mcl_depth.geometry.cloud import farthest_of, lonely_share
from mcl_depth.geometry.geodetic import METERS
from mcl_depth.params import SurveyParams
from sphere_nav.geometry.arrays import Array

ROTATIONS = {"z": np.eye(3), "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])}


@dataclass(frozen=True)
class SurveyFrame:
    """How coordinates of a file become those of the map: R (3, 3) times metres a unit, less the origin (3,) m."""

    unit: str = "m"
    up: str = "z"
    origin: Array = field(default_factory=lambda: np.zeros(3))
    words: str = ""  # what was done and why; empty where a file is used as it is

    def turn(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return points (N, 3) in metres, z up, about the origin of the file."""
        return METERS[self.unit] * np.asarray(points, np.float64) @ ROTATIONS[self.up].T

    def apply(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return points (N, 3) m of the map."""
        return self.turn(points) - self.origin


def find_frame(
    points: NDArray[np.floating], params: SurveyParams, name: str, declared: str = "", *, is_mesh: bool = False
) -> SurveyFrame:
    """Return the frame of a file's points (N, 3); `declared` is the unit that the file itself tells.

    Vertices of a mesh are too few to tell the axis that points up.

    ValueError where the coordinates are degrees, or nothing stands on the ground.
    """
    given = _read_origin(params.origin)
    finite = points[np.isfinite(points).all(axis=1)]
    if not len(finite):
        return SurveyFrame()
    if not is_mesh:
        refuse_stray(finite, name)
    low, high = finite.min(axis=0).astype(np.float64), finite.max(axis=0).astype(np.float64)
    is_large = len(finite) >= MIN_POINTS
    unit, why = (params.unit, "as was set") if params.unit != "auto" else (declared, "as the file declares")
    if not unit:
        unit, why = _guess_unit(finite, low, high, name) if is_large else ("m", "")
    up = "z" if params.up == "auto" else params.up
    if is_large and not is_mesh:
        sample = finite[:: max(len(finite) // SURVEY_SAMPLES, 1)] - low
        up = _find_up(METERS[unit] * sample) if params.up == "auto" else up
        _refuse_plain(SurveyFrame(unit, up).turn(sample), name)
    corners = SurveyFrame(unit, up).turn(np.array([low, high]))
    origin = given if given is not None else _find_origin(corners) if is_large else np.zeros(3)
    words = [] if unit == "m" else [f"taken as {unit} ({why})"]
    if up == "y":
        words.append(f"y is up ({'as was set' if params.up == 'y' else 'the ground lies across it'})")
    if origin.any():
        words.append("its origin is E,N,H = " + ",".join(f"{value:.12g}" for value in origin) + " m")
    return SurveyFrame(unit, up, origin, f"{name}: {'; '.join(words)}" if words else "")


def _find_origin(corners: Array) -> Array:
    """Return what is near the corners (2, 3) of points that are far from their origin, else that: (3,) m."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    origin = np.zeros(3)
    if farthest_of(float((high - low).max())) < np.abs(corners)[:, :2].max() <= MAX_COORDINATE_M:
        origin[:2] = np.floor(low[:2] / ORIGIN_STEP_M) * ORIGIN_STEP_M
    return origin


def refuse_stray(points: NDArray[np.floating], name: str) -> None:
    """Refuse a point (of N, 3; finite) far outside of all others: unit, axis and area would be found by it alone."""
    if len(points) < MIN_POINTS:
        return
    sample = points[:: max(len(points) // SURVEY_SAMPLES, 1)]
    middle = np.median(sample, axis=0)
    inner = float(np.quantile(np.abs(sample - middle).max(axis=1), 1.0 - STRAY_SHARE, method="lower"))
    if max((points.max(axis=0) - middle).max(), (middle - points.min(axis=0)).max()) > STRAY_RATIO * inner:
        farthest = points[np.abs(points - middle).max(axis=1).argmax()]
        found = f"{2.0 * inner:.3g}, and one at " + ", ".join(f"{value:.6g}" for value in farthest)
        raise ValueError(
            f"{name}: points: expected one place, found {1.0 - STRAY_SHARE:.1%} in a width of {found}: cut it off"
        )


def survey_box(survey: SurveyParams, limits: Array | None, unit: str) -> Array | None:
    """Return what of a file counts for a map of `limits` (x0, y0, x1, y1) m: its box, in the unit of the file.

    None, all of it, where origin, unit and axis are only found by all of its points.
    """
    origin = _read_origin(survey.origin)
    if limits is None or origin is None or not unit or survey.up == "y":
        return None
    return np.asarray((limits + np.tile(origin[:2], 2)) / METERS[unit])


def _read_origin(text: str) -> Array | None:
    return numbers_of(text, 3, "survey.origin: expected E,N,H in m")


def numbers_of(text: str, count: int, expected: str) -> Array | None:
    """Return so many finite numbers between commas, None of an empty text; ValueError with what was expected."""
    if not text:
        return None
    try:
        numbers = np.array(text.split(","), np.float64)
    except ValueError:
        numbers = np.zeros(0)
    if len(numbers) != count or not np.all(np.isfinite(numbers)):
        raise ValueError(f"{expected}, found {text!r}")
    return numbers


def _guess_unit(points: NDArray[np.floating], low: Array, high: Array, name: str) -> tuple[str, str]:
    """Return the unit by the extent of points (N, 3): a place to drive is 1 m to some km wide; ValueError for degrees.

    `low`, `high` (3,) are their box.
    """
    extent = high - low
    widest = float(extent.max())
    is_globe = np.all(np.abs([low, high])[:, :2] <= [180.0, 90.0]) and extent[:2].max() < 1.0
    if is_globe and extent[2] > 10.0 * extent[:2].max() and extent[2] > 1.0:
        found = f"an extent of {extent[0]:.2g} x {extent[1]:.2g} x {extent[2]:.2g}"
        raise ValueError(f"{name}: points: expected metres, found {found}: longitude and latitude? project it first")
    if widest < SMALL_EXTENT:
        return "km", f"{widest:.3g} wide"
    if widest > LARGE_EXTENT_M and lonely_share(points - low) > MAX_LONELY >= lonely_share((points - low) / 1000.0):
        return "mm", f"{widest:.3g} wide and the points that far from each other"
    return "m", ""


def _find_up(points: NDArray[np.floating]) -> str:
    """Return z, or y where far more of a floor lies across y: area (m2) over which the lowest points go on evenly."""
    area = {up: _floor_area(points @ rotation.T) for up, rotation in ROTATIONS.items()}
    return "y" if area["y"] > UP_RATIO * area["z"] else "z"


def _floor_area(points: NDArray[np.floating]) -> float:
    lowest, _, cell = _columns(points)
    with np.errstate(invalid="ignore"):
        is_even = [np.abs(np.diff(lowest, axis=axis)) < 0.3 * cell for axis in (0, 1)]
    return 0.5 * cell**2 * float(sum(np.count_nonzero(part) for part in is_even))


def _refuse_plain(points: NDArray[np.floating], name: str) -> None:
    """Refuse a plain: nothing that a camera could see stands on it."""
    lowest, highest, cell = _columns(points)
    share = float(np.mean((highest - lowest)[np.isfinite(lowest)] > cell))
    if share < LEAST_STANDING:
        found = f"{share:.2%} of squares of {cell:.2g} m with anything higher than that"
        raise ValueError(f"{name}: points: expected walls or the like above the ground, found {found}")


def _columns(points: NDArray[np.floating]) -> tuple[Array, Array, float]:
    """Return lowest and highest z (X, Y) of a grid of columns, +Inf and -Inf without points, and its step in m."""
    points = points - points.min(axis=0)
    extent = points.max(axis=0)
    cell = max(GROUND_STEP, float(np.sqrt(8.0 * extent[0] * extent[1] / len(points))), float(extent.max()) / 4000.0)
    cells = np.floor(points[:, :2] / cell).astype(np.int64)
    lowest = np.full(cells.max(axis=0) + 1, np.inf)
    highest = -lowest
    np.minimum.at(lowest, tuple(cells.T), points[:, 2])
    np.maximum.at(highest, tuple(cells.T), points[:, 2])
    return lowest, highest, cell
