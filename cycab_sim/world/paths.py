"""Paths along the streets: straight pieces and arcs that a car can drive, by arc length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sphere_nav.geometry.arrays import Array


@dataclass(frozen=True)
class Piece:
    """A piece of constant curvature 1/m (positive to the left) and length m."""

    length: float
    curvature: float = 0.0


@dataclass(frozen=True)
class Path:
    """Pieces that follow each other from a start pose (x m, y m, yaw rad) of the rear axle."""

    start: tuple[float, float, float]
    pieces: tuple[Piece, ...]
    is_closed: bool = False

    @property
    def length(self) -> float:
        """Length in metres."""
        return sum(piece.length for piece in self.pieces)

    def at(self, distance: ArrayLike) -> Array:
        """Return (..., 4) x m, y m, yaw rad, curvature 1/m at distances from the start; straight on beyond the ends."""
        s = np.asarray(distance, dtype=np.float64)
        if self.is_closed:
            s = s % self.length
        lengths, curvatures = np.array([(piece.length, piece.curvature) for piece in self.pieces]).T
        starts, begins = [np.array(self.start)], np.concatenate([[0.0], np.cumsum(lengths[:-1])])
        for piece in self.pieces[:-1]:
            starts.append(arc(starts[-1], piece.length, piece.curvature))
        here = np.maximum(np.searchsorted(begins, s, side="right") - 1, 0)
        along, curvature = s - begins[here], curvatures[here]
        inside = np.clip(along, 0.0, lengths[here])
        ends = arc(np.array(starts)[here], inside, curvature)
        ends[..., 0] += (along - inside) * np.cos(ends[..., 2])
        ends[..., 1] += (along - inside) * np.sin(ends[..., 2])
        return np.concatenate([ends, curvature[..., None]], axis=-1)


def arc(pose: ArrayLike, length: ArrayLike, curvature: Array | float) -> Array:
    """Return the pose (..., 3) after driving `length` m (negative: backwards) on constant curvature: exact."""
    x, y, yaw = np.moveaxis(np.asarray(pose, dtype=np.float64), -1, 0)
    d = np.asarray(length, dtype=np.float64)
    turn = d * curvature
    chord = d * np.sinc(turn / (2.0 * np.pi))  # sinc(t) = sin(pi t) / (pi t)
    return np.stack([x + chord * np.cos(yaw + turn / 2), y + chord * np.sin(yaw + turn / 2), yaw + turn], axis=-1)


def turn(radius: float, degrees: float) -> Piece:
    """Return an arc of `radius` m to the left, or to the right for negative degrees."""
    angle = np.radians(degrees)
    return Piece(radius * abs(angle), float(np.sign(degrees)) / radius)


def rounded(corners: Array, radius: float) -> Path:
    """Return the closed path along a polygon (K, 2) m whose corners are arcs of `radius` m."""
    legs = np.roll(corners, -1, axis=0) - corners
    lengths, headings = np.linalg.norm(legs, axis=1), np.arctan2(legs[:, 1], legs[:, 0])
    turns = (np.roll(headings, -1) - headings + np.pi) % (2 * np.pi) - np.pi  # at the end of each leg
    cuts = radius * np.tan(np.abs(turns) / 2)
    straight = lengths - cuts - np.roll(cuts, 1)
    if straight.min() < 0.0:
        raise ValueError(f"radius: expected arcs that fit between the corners, found {radius} m")
    pieces = [
        piece
        for length, angle in zip(straight, turns, strict=True)
        for piece in (Piece(float(length)), turn(radius, float(np.degrees(angle))))
    ]
    x, y = corners[0] + cuts[-1] * legs[0] / lengths[0]
    return Path((float(x), float(y), float(headings[0])), tuple(pieces), is_closed=True)
