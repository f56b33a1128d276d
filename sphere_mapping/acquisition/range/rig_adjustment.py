"""How far matches of two cameras are off their epipolar planes and known ranges, and how that follows from the cameras.

A camera has six values: turn (3) in rad, logarithm of the focal length, centre (2) in shares of it. An error is a
function of two rays, and a ray changes with its own camera's values only: every match has slopes for two cameras.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from sphere_mapping.acquisition.constants import NEAR_EPIPOLE, PIXEL_STEP, RANGE_SHARE, RAY_STEP
from sphere_nav.geometry import SE3, Rig, RigCamera
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.so3 import hat, left_jacobian

Error = Callable[[Array, Array, Array], Array]  # of rays (N, 3) of both cameras and the baseline (3,) -> (N,) rad

NUM_VALUES = 6  # of a camera


@dataclass(frozen=True, eq=False)
class Matches:
    """Pixels (N, 2) of two cameras that show the same; how far it is from the first (N,) m, NaN where unknown."""

    first: str
    second: str
    pixels_first: Array
    pixels_second: Array
    range_first: Array | None = None


def correct(rig: Rig, values: Array) -> Rig:
    """Return the rig whose cameras are changed by their values (6 N,)."""
    parts = [_change(part, own) for part, own in zip(rig.cameras, values.reshape(-1, NUM_VALUES), strict=True)]
    return replace(rig, cameras=tuple(parts))


def epipolar_errors(rig: Rig, matches: Sequence[Matches]) -> Array:
    """Return the signed angle (M,) in rad of all matches off their epipolar planes; smaller near the baseline."""
    found = [_off_plane(*_rays(rig, match)) for match in matches]
    return np.nan_to_num(np.concatenate([np.zeros(0), *found]))


def match_angles(rig: Rig, matches: Sequence[Matches], scale: float) -> Array:
    """Return the angles (M,) by the scale, of all matches off their planes and of those with range off their place."""
    found = [error(*_rays(rig, match)) for match, error in _terms(matches, scale)]
    return np.nan_to_num(np.concatenate(found)) / scale


def slopes(rig: Rig, values: Array, matches: Sequence[Matches], scale: float) -> Array:
    """Return the change (M, 6 N) of `match_angles` of the corrected rig with the values (6 N,)."""
    guess, rows = correct(rig, values), []
    for match, error in _terms(matches, scale):
        x, y, along = _rays(guess, match)
        by_x = _by_ray(partial(lambda error, y, along, ray: error(ray, y, along), error, y, along), x)
        by_y = _by_ray(partial(lambda error, x, along, ray: error(x, ray, along), error, x, along), y)
        row = np.zeros((len(x), values.size))
        for name, pixels, by_ray in (
            (match.first, match.pixels_first, by_x),
            (match.second, match.pixels_second, by_y),
        ):
            own = slice(NUM_VALUES * rig.names.index(name), NUM_VALUES * (rig.names.index(name) + 1))
            row[:, own] = np.einsum("ni,nik->nk", by_ray, _ray_by_values(rig.camera(name), values[own], pixels))
        rows.append(row)
    return np.nan_to_num(np.concatenate(rows)) / scale


def _terms(matches: Sequence[Matches], scale: float) -> Iterator[tuple[Matches, Error]]:
    for match in matches:
        yield match, _off_plane
    for match in matches:
        if match.range_first is not None:
            yield match, partial(_off_range, match.range_first, scale)


def _off_plane(x: Array, y: Array, along: Array) -> Array:
    """Return the signed angle (N,) of rays y off the planes of rays x and the baseline; smaller near the baseline."""
    normal = np.cross(along / np.linalg.norm(along), x)
    return np.sum(normal * y, axis=1) / np.maximum(np.linalg.norm(normal, axis=1), NEAR_EPIPOLE)


def _off_range(range_m: Array, scale: float, x: Array, y: Array, along: Array) -> Array:
    """Return the angle (N,) of rays y off where on the epipolar line a range (N,) along x puts them.

    Scaled down where the range, known to RANGE_SHARE of it, says less than `scale` about that place.
    """
    seen = x * range_m[:, None] - along
    seen = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    normal = np.cross(along, seen)
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    parallax = np.linalg.norm(np.cross(x, seen), axis=1)
    return np.sum(np.cross(normal, seen) * y, axis=1) / np.hypot(1.0, RANGE_SHARE * parallax / scale)


def _rays(rig: Rig, match: Matches) -> tuple[Array, Array, Array]:
    """Return the rays (N, 3) of both cameras and their baseline (3,) in the frame of the rig."""
    first, second = rig.camera(match.first), rig.camera(match.second)
    x = first.camera.unproject(match.pixels_first) @ first.T_rig_camera.rotation.T
    y = second.camera.unproject(match.pixels_second) @ second.T_rig_camera.rotation.T
    return x, y, second.T_rig_camera.translation - first.T_rig_camera.translation


def _by_ray(error: Callable[[Array], Array], rays: Array) -> Array:
    """Return the slopes (N, 3) of an error with the rays."""
    steps = RAY_STEP * np.eye(3)
    return np.stack([(error(rays + step) - error(rays - step)) / (2 * RAY_STEP) for step in steps], axis=1)


def _ray_by_values(part: RigCamera, own: Array, pixels: Array) -> Array:
    """Return the change (N, 3, 6) of the rays of pixels, in the frame of the rig, with the camera's values.

    A shifted centre is a shifted pixel, a longer focal length a pixel nearer to the centre.
    """
    moved = _change(part, own)
    camera: Any = moved.camera
    steps = PIXEL_STEP * np.eye(2)
    shifted = [camera.unproject(pixels + step) - camera.unproject(pixels - step) for step in steps]
    by_u, by_v = (change / (2 * PIXEL_STEP) for change in shifted)
    by_turn = -hat(camera.unproject(pixels)) @ left_jacobian(-own[:3])
    from_center = pixels - (camera.cx, camera.cy)
    by_focal = -(by_u * from_center[:, :1] + by_v * from_center[:, 1:])
    fx, fy = part.camera.coefficients[:2]
    by_lens = np.stack([by_focal, -fx * by_u, -fy * by_v], axis=2)
    return moved.T_rig_camera.rotation @ np.concatenate([by_turn, by_lens], axis=2)


def _change(part: RigCamera, own: Array) -> RigCamera:
    camera: Any = part.camera  # pinhole, fisheye, double sphere: all have these four
    factor = float(np.exp(own[3]))
    lens = {
        "fx": camera.fx * factor,
        "fy": camera.fy * factor,
        "cx": camera.cx + camera.fx * float(own[4]),
        "cy": camera.cy + camera.fy * float(own[5]),
    }
    turn = SE3.exp(np.concatenate([np.zeros(3), own[:3]]))
    return replace(part, camera=replace(camera, **lens), T_rig_camera=part.T_rig_camera @ turn)
