"""The motion between two spheres by direct registration, as one result."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from sphere_mapping.graph.both_ways import FEATURES, ONE_WAY, find_motion, why_denied
from sphere_mapping.graph.registration import PreparedSphere, align_sphere, guess_by_rotation
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.photometric import Alignment
from sphere_nav.spheres.sphere import Sphere

RESIDUAL = ("mad", "ncc", "overlap", "inlier_share", "num_pixels")  # how well the images agree
REMEDY = "smaller steps between the images (slower, more a second), more range in them"


@dataclass(frozen=True, eq=False)
class Registration:
    """The motion between two spheres.

    covariance (6, 6), m and rad, is that of xi = (v, omega) in T_a_b @ exp(xi). Where `is_converged` is false, `reason`
    says why, and the pose is the best that was found.
    """

    T_a_b: SE3
    covariance: Array
    is_converged: bool
    reason: str
    alignment: Alignment

    def values(self) -> dict[str, Any]:
        """Return all as plain values, for JSON."""
        return {
            "is_converged": self.is_converged,
            "reason": self.reason,
            "T_a_b": {
                "translation_m": self.T_a_b.translation.tolist(),
                "quaternion_xyzw": self.T_a_b.quaternion.tolist(),
                "matrix": self.T_a_b.matrix.tolist(),
                "angle_deg": float(np.degrees(SE3.identity().distance(self.T_a_b)[1])),
            },
            "covariance": finite(self.covariance),
            "residual": {name: getattr(self.alignment, name) for name in RESIDUAL},
            "iterations": self.alignment.iterations,
            "gain": self.alignment.gains[0],
            "bias": self.alignment.biases[0],
        }


def register_spheres(a: Sphere, b: Sphere, T_a_b_guess: SE3) -> Registration:
    """Return the alignment of b with a.

    The motion may be any: features with range give the first guess, the one given and none at all come after it. What
    the way back or features contradict is not converged.
    """
    reference, current = (PreparedSphere(sphere) for sphere in (a, b))

    proven = find_motion(reference, current) if b.measured.any() else None
    if proven is not None:
        found = replace(proven.forward, T_world_camera=proven.T_a_b, covariance=proven.covariance)
    else:
        guesses = T_a_b_guess, guess_by_rotation(current, reference, SE3.identity())
        check = partial(why_denied, reference, current, is_expected=False)
        found = align_sphere(current, [reference.at(SE3.identity())], guesses, check)
    return Registration(found.T_world_camera, found.covariance, found.is_converged, found.reason, found)


def describe_refusal(reason: str) -> str:
    """Return one line on why an alignment was refused, and what would help."""
    words = {ONE_WAY: "the way back disagrees", FEATURES: "features agree on another motion"}
    why = f"refused ({reason}): {words[reason]}" if reason in words else f"refused ({reason})"
    return f"{why}; {REMEDY}, or a first guess (--guess, by odometry), would help"


def finite(matrix: np.ndarray) -> list[list[float | None]]:
    """Return a matrix for JSON, which has no infinity."""
    return [[float(value) if np.isfinite(value) else None for value in row] for row in matrix]
