"""Ways along streets."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cycab_sim.world.paths import Path, Piece, turn


def rounded_way(corners: ArrayLike, radius: float = 6.0) -> Path:
    """Return the way along an open polygon (K, 2) m whose inner corners are arcs, as far as its legs allow."""
    points = np.asarray(corners, dtype=np.float64)
    legs = np.diff(points, axis=0)
    lengths, heads = np.hypot(*legs.T), np.arctan2(legs[:, 1], legs[:, 0])
    turns = (np.diff(heads) + np.pi) % (2 * np.pi) - np.pi
    radii = np.minimum(radius, np.minimum(lengths[:-1], lengths[1:]) / 2)
    cuts = np.concatenate([[0.0], radii * np.tan(np.abs(turns) / 2), [0.0]])
    pieces: list[Piece] = []
    for number, length in enumerate(lengths):
        pieces.append(Piece(float(length - cuts[number] - cuts[number + 1])))
        if number < len(turns):
            pieces.append(turn(float(radii[number]), float(np.degrees(turns[number]))))
    return Path((*points[0].tolist(), float(heads[0])), tuple(pieces))
