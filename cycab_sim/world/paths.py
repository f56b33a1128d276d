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
        poses = np.empty((*s.shape, 4))
        pose, begin = np.array(self.start), 0.0
        for i, piece in enumerate(self.pieces):
            is_last = i == len(self.pieces) - 1
            here = (s >= begin) if i else np.ones(s.shape, bool)
            along = s[here] - begin
            inside = np.clip(along, 0.0, piece.length)
            ends = arc(pose, inside, piece.curvature)
            beyond = along - inside if is_last else np.minimum(along, 0.0)
            ends[..., 0] += beyond * np.cos(ends[..., 2])
            ends[..., 1] += beyond * np.sin(ends[..., 2])
            poses[here] = np.concatenate([ends, np.full((*inside.shape, 1), piece.curvature)], axis=-1)
            pose, begin = arc(pose, piece.length, piece.curvature), begin + piece.length
        return poses


def arc(pose: ArrayLike, length: ArrayLike, curvature: float) -> Array:
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
