"""Poses that a search tries, the likeliest first, all of them different places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dense_localizer.constants import SAME_POSE_DEG, SAME_POSE_M
from sphere_nav.geometry import SE3
from sphere_nav.spheres.graph import KeySphere


@dataclass(frozen=True)
class Guess:
    """A pose to try against one key sphere, and how much speaks for it: how well the image resembles it there."""

    node: KeySphere
    T_map_camera: SE3
    score: float = -1.0


def select_best(guesses: Sequence[Guess], count: int) -> list[Guess]:
    """Return the guesses for which most speaks; equal ones stay in the order of the map."""
    return sorted(guesses, key=lambda guess: -guess.score)[:count]


def select_distinct(guesses: Sequence[Guess], count: int) -> list[Guess]:
    """Return the first so many guesses that are different places."""
    kept: list[Guess] = []
    for guess in guesses:
        if len(kept) == count:
            break
        if not any(is_same_pose(guess.T_map_camera, other.T_map_camera) for other in kept):
            kept.append(guess)
    return kept


def is_same_pose(a: SE3, b: SE3) -> bool:
    """Say whether two poses are one place."""
    distance, angle = a.distance(b)
    return bool(distance < SAME_POSE_M and angle < np.radians(SAME_POSE_DEG))
