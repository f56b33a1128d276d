"""READ FIRST. A photo-realistic view from any pose near key spheres (M15 section 6.3.2).

The surface that each sphere saw is drawn from the new pose with a z-buffer; then the drawings are blended: where they
show the same surface by their weights, elsewhere the nearer one hides the other. What no sphere saw stays a hole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike

from sphere_nav.geometry import SE3, Camera, Pinhole, Spherical
from sphere_nav.geometry.arrays import Array, Bytes, Flags, Floats
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.photometric.pixels.pyramid import kernel_camera, kernel_motion
from sphere_nav.spheres.sphere import Sphere
from sphere_nav.view_synthesis import kernels
from sphere_nav.view_synthesis.constants import FAR_NEARNESS, MIN_KNOWN_NEIGHBORS, POLE_RAD, SAME_SURFACE
from sphere_nav.view_synthesis.surface import Surface, surface_of

POLES = (SE3.exp([0, 0, 0, np.pi, 0, 0]), SE3.identity())  # looking down and up along the axis of a sphere


@dataclass(frozen=True, eq=False)
class SynthesizedView:
    """A synthesised image (H, W, 3) u8, range along the ray (H, W) f32 m, and where anything was seen (H, W)."""

    image: Bytes
    range_m: Floats
    is_known: Flags


@dataclass(frozen=True, eq=False)
class PlacedSurface:
    """A surface in the map, and its weight in the blend."""

    surface: Surface
    T_map_sphere: SE3
    weight: float = 1.0


def synthesize(surfaces: Sequence[PlacedSurface], T_map_camera: SE3, camera: Camera) -> SynthesizedView:
    """Return the view of a camera of any model from a pose in the map; ValueError without a surface."""
    if not surfaces:
        raise ValueError("view synthesis: expected at least one key sphere, found none")
    drawings = [draw_surfaces(one.surface, T_map_camera.inverse() @ one.T_map_sphere, camera) for one in surfaces]
    nearest = drawings[0][0]
    for nearness, _ in drawings[1:]:
        nearest = np.maximum(nearest, nearness)
    total, weights = np.zeros((*nearest.shape, 3), np.float32), np.zeros((*nearest.shape, 1), np.float32)
    share, floor = SAME_SURFACE
    for one, (nearness, source) in zip(surfaces, drawings, strict=True):
        is_front = (nearness > 0.0) & (nearest - nearness <= np.maximum(floor, share * nearest))
        weight = np.float32(max(one.weight, 1e-3)) * is_front[..., None]  # what one alone saw is never left out
        total += weight * _colors_at(one.surface, source)
        weights += weight
    is_known = weights[..., 0] > 0.0
    colors = np.clip(total / np.where(weights > 0.0, weights, 1.0) + 0.5, 1.0, 255.0) * is_known[..., None]
    with np.errstate(divide="ignore"):
        range_m = np.where(nearest > 2.0 * FAR_NEARNESS, 1.0 / nearest, np.inf).astype(np.float32)
    return _close_pinholes(colors.astype(np.uint8), np.where(is_known, range_m, np.float32(np.nan)), is_known)


def _colors_at(surface: Surface, source: Floats) -> Bytes:
    """Return the colours (H, W, 3) of a sphere's image at places (u, v) (H, W, 2)."""
    border = cv2.BORDER_WRAP if surface.camera.is_whole else cv2.BORDER_REPLICATE
    rows = np.clip(source[..., 1], 0.0, surface.camera.height - 1.0)
    return np.asarray(cv2.remap(surface.image, source[..., 0], rows, cv2.INTER_LINEAR, borderMode=border), np.uint8)


def _close_pinholes(image: Bytes, range_m: Floats, is_known: Flags) -> SynthesizedView:
    """Give holes with at least `MIN_KNOWN_NEIGHBORS` of 8 known neighbours their mean colour and largest range."""
    number, total = (
        cv2.boxFilter(one, cv2.CV_32F, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
        for one in (is_known.astype(np.uint8), image)
    )
    closed = ~is_known & (number >= MIN_KNOWN_NEIGHBORS)
    farthest = cv2.dilate(np.nan_to_num(range_m, posinf=np.inf), np.ones((3, 3)))
    image[closed], range_m[closed] = total[closed] / number[closed, None], farthest[closed]
    return SynthesizedView(image, range_m, is_known | closed)


def draw_surfaces(surface: Surface, T_camera_sphere: SE3, camera: Camera) -> tuple[Floats, Floats]:
    """Return nearness (H, W) 1/m, 0 where nothing is, and where in the sphere's image (u, v) (H, W, 2) it was seen."""
    placed = np.empty((surface.points.shape[1], 3), np.float32)
    kernels.project_corners(surface.points, kernel_motion(T_camera_sphere.matrix), kernel_camera(camera), placed)
    nearness = np.zeros((camera.height, camera.width), np.float32)
    source = np.zeros((camera.height, camera.width, 2), np.float32)
    kernels.draw_quads(surface.corners, placed, surface.pixels, surface.camera.width, camera.is_whole, nearness, source)
    for pole in POLES if camera.is_whole else ():
        _draw_pole(surface, T_camera_sphere, camera, pole, nearness, source)
    return nearness, source


def _draw_pole(
    surface: Surface, T_camera_sphere: SE3, camera: Camera, T_camera_pole: SE3, nearness: Floats, source: Floats
) -> None:
    """Draw what lies around a pole of a whole sphere, where quads have no left and right, by a camera that looks there.

    The camera is turned only, so that its nearness is that of the sphere.
    """
    side = max(8, round(camera.pixels_per_radian))
    focal = 0.5 * side / np.tan(POLE_RAD + 2.0 / side)
    pinhole = Pinhole(side, side, focal, focal, 0.5 * (side - 1), 0.5 * (side - 1))
    near, place = draw_surfaces(surface, T_camera_pole.inverse() @ T_camera_sphere, pinhole)
    rays = pixel_rays(camera)
    rows = np.flatnonzero(rays[:, 0] @ T_camera_pole.rotation[:, 2] > np.cos(POLE_RAD))
    pixels, _ = pinhole.project(rays[rows] @ T_camera_pole.rotation)
    u, v = np.clip(np.rint(pixels), 0, side - 1).astype(np.intp).transpose(2, 0, 1)
    nearness[rows], source[rows] = near[v, u], place[v, u]


def blend_weights(distances_m: ArrayLike) -> Array:
    """Return the weights (K - 1,) of all spheres but the farthest of K, by distance; they sum to 1.

    A sphere that is as far as the one left out has weight 0, so that nothing jumps where spheres are exchanged.
    """
    distances = np.asarray(distances_m, dtype=np.float64)
    near, limit = distances[:-1], max(float(distances[-1]), 1e-9)
    weights = (1.0 - near / limit) / np.maximum(near, 1e-3 * limit)
    total = float(weights.sum())
    return weights / total if total > 0 else np.full(near.shape, 1.0 / near.size)


def warm_up() -> None:
    """Compile the kernels on a sphere too small to cost anything; some seconds, or nothing where the cache has them."""
    camera = Spherical(32, 16)
    sphere = Sphere(np.full((16, 32, 3), 9, np.uint8), np.full((16, 32), 5.0, np.float32), camera)
    synthesize([PlacedSurface(surface_of(sphere), SE3.identity())], SE3.identity(), camera)
