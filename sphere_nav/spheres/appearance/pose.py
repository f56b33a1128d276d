"""Where an image was taken from, by features matched with those of a key sphere: three rays and three points, by lot.

The pose is a guess good enough for dense alignment to begin with, at any heading and metres away from the sphere.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array, Flags, Floats, Integers
from sphere_nav.geometry.so3 import hat
from sphere_nav.spheres.appearance.features import Features
from sphere_nav.spheres.constants import (
    MAX_MATCH_RATIO,
    MAX_RAY_ANGLE,
    MIN_FORWARD,
    NUM_POSE_REFINEMENTS,
    NUM_POSE_TRIALS,
)


@dataclass(frozen=True)
class FeaturePose:
    """T_sphere_camera by so many of the matched features."""

    T_sphere_camera: SE3
    num_inliers: int


def match_features(query: Features, known: Features) -> Integers:
    """Return rows (M, 2) of features that are each other's best match and clearly better than the second."""
    return choose_each_other(1.0 - query.unit_descriptors() @ known.unit_descriptors().T, MAX_MATCH_RATIO**2)


def choose_each_other(costs: Floats, ratio: float) -> Integers:
    """Return rows and columns (M, 2) of least costs (N, K) of both, in their row less than `ratio` of the second."""
    if min(costs.shape) < 2:
        return np.zeros((0, 2), np.int64)
    rows, best = np.arange(len(costs)), np.argmin(costs, axis=1)
    second = np.partition(costs, 1, axis=1)[:, 1]
    is_clear = costs[rows, best] < ratio * second
    is_mutual = np.argmin(costs, axis=0)[best] == rows
    return np.stack([rows, best], axis=1)[is_clear & is_mutual]


def find_pose(query: Features, known: Features) -> FeaturePose | None:
    """Return where `query` was taken in the frame of the sphere `known`; None where fewer than four features agree."""
    pairs = match_features(query, known)
    pairs = pairs[np.isfinite(known.range_m[pairs[:, 1]])]
    if len(pairs) < 4:
        return None
    rays, points = query.rays[pairs[:, 0]].astype(np.float64), known.points[pairs[:, 1]].astype(np.float64)
    rng = np.random.default_rng(0)
    best, best_inliers = None, np.zeros(len(pairs), np.bool_)
    for trial in range(NUM_POSE_TRIALS):
        if trial >= _enough(best_inliers):
            break
        three = rng.choice(len(pairs), 3, replace=False)
        for T_camera_sphere in _solve_three(rays[three], points[three]):
            inliers = _angles(T_camera_sphere, rays, points) < MAX_RAY_ANGLE
            if inliers.sum() > best_inliers.sum():
                best, best_inliers = T_camera_sphere, inliers
    if best is None or best_inliers.sum() < 4:
        return None
    for _ in range(NUM_POSE_REFINEMENTS):
        best = _refine(best, rays[best_inliers], points[best_inliers])
        best_inliers = _angles(best, rays, points) < MAX_RAY_ANGLE
        if best_inliers.sum() < 4:
            return None
    return FeaturePose(best.inverse(), int(best_inliers.sum()))


def _enough(inliers: Flags) -> float:
    """Return the trials after which three right matches were drawn with 99.9 %, were the inliers all right ones."""
    share = float(inliers.mean()) ** 3
    return np.log(1e-3) / np.log(1.0 - share) if 0.0 < share < 1.0 else (1.0 if share else np.inf)


def _solve_three(rays: Array, points: Array) -> list[SE3]:
    """Return up to four T_camera_sphere that send three points (3, 3) along three rays (3, 3)."""
    middle = rays.sum(axis=0)
    middle /= max(float(np.linalg.norm(middle)), 1e-9)
    side = np.cross(middle, np.eye(3)[np.argmin(np.abs(middle))])
    side /= np.linalg.norm(side)
    turn = np.stack([side, np.cross(middle, side), middle])  # to axes whose z is the middle of the rays
    ahead = rays @ turn.T
    if np.any(ahead[:, 2] < MIN_FORWARD):
        return []
    try:
        _, rotations, translations = cv2.solveP3P(
            points.reshape(3, 1, 3), (ahead[:, :2] / ahead[:, 2:]).reshape(3, 1, 2), np.eye(3), None, cv2.SOLVEPNP_AP3P
        )
    except cv2.error:  # points on a line
        return []
    found = []
    for rotation, translation in zip(rotations, translations, strict=True):
        if np.all(np.isfinite([rotation, translation])):
            found.append(SE3.from_parts(turn.T @ cv2.Rodrigues(rotation)[0], turn.T @ translation.ravel()))
    return found


def _angles(T_camera_sphere: SE3, rays: Array, points: Array) -> Array:
    """Return the angle (M,) between each ray and its point."""
    seen = T_camera_sphere.apply(points)
    sine = np.linalg.norm(np.cross(rays, seen), axis=1)
    return np.arctan2(sine, np.einsum("ni,ni->n", rays, seen))


def _refine(T_camera_sphere: SE3, rays: Array, points: Array) -> SE3:
    """Return the pose after one Gauss-Newton step on the chords between rays and directions of points."""
    seen = T_camera_sphere.apply(points)
    distance = np.linalg.norm(seen, axis=1)
    unit = seen / distance[:, None]
    across = (np.eye(3) - unit[:, :, None] * unit[:, None, :]) / distance[:, None, None]  # d unit / d seen
    by_step = np.concatenate([np.broadcast_to(np.eye(3), across.shape), -hat(points)], axis=2)  # T exp(xi) p
    J = (across @ T_camera_sphere.rotation @ by_step).reshape(-1, 6)
    H = J.T @ J + 1e-9 * np.eye(6)
    return T_camera_sphere @ SE3.exp(np.linalg.solve(H, J.T @ (rays - unit).ravel()))
