"""Another light for recorded images of known depth and pose: a lamp, or a sun with shadows, patches and a torch.

Light is of the world: shadows lie on the geometry, patches are anchored to it, a torch moves with the camera.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.rgbd_data import CAMERA, Frame
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.camera import pixel_rays

BLUR_PX = 12.0  # of the mean about which it is inverted, at 640 x 480
NORMAL_PX = 4.0  # over which normals are smoothed: ranges are rough
PATCH_M = 0.7  # wavelength of patches of which the contrast is inverted
CELL_M, BIAS_M = 0.02, 0.06  # side of a cell of the map of shadows; what is nearer to the occluder is lit
LAMP_M, NEAR_M = 1.0, 0.7  # how far a lamp lights; nearer than this a torch is no brighter
Gray = NDArray[np.float32]


def torch_light(points: Array, normals: Array) -> Array:
    """Return the brightness (H, W) of points (H, W, 3) by a torch beside the lens."""
    distance = np.linalg.norm(points, axis=-1)
    beam = np.exp(-((points[..., 0] / points[..., 2]) ** 2 + (points[..., 1] / points[..., 2]) ** 2) / 0.18)
    shade = np.abs(np.sum(points * normals, axis=-1)) / distance
    return np.asarray(beam * shade / np.maximum(distance, NEAR_M) ** 2)


class Light:
    """Another light of a room: what a camera at a pose would see of its surfaces by it."""

    def __init__(self, kind: str, share: float, seed: int, frames: Sequence[Frame]) -> None:
        self._kind, self._share = kind, share
        random = np.random.default_rng(seed)
        points = [self._points(frame.depth_m)[0][::4, ::4].reshape(-1, 3) for frame in frames]
        clouds = [frame.T_world_camera.apply(one) for frame, one in zip(frames, points, strict=True)]
        world = np.concatenate(clouds)
        up = -np.mean([frame.T_world_camera.rotation[:, 1] for frame in frames], axis=0)
        back = -np.mean([frame.T_world_camera.rotation[:, 2] for frame in frames], axis=0)
        self._lamp = np.mean(world, axis=0) + LAMP_M * (random.normal(0.0, 0.5, 3) + 0.7 * up + 0.8 * back)
        direction = up + random.uniform(0.2, 0.9) * back + random.normal(0.0, 0.5, 3)
        self._sun = direction / np.linalg.norm(direction)
        self._waves = random.normal(0.0, 2.0 * np.pi / PATCH_M, (6, 3)), random.uniform(0.0, 2.0 * np.pi, 6)
        self._shadow_map(world)

    def shine(self, gray: Gray, depth_m: Gray, T_world_camera: SE3) -> Gray:
        """Return the image in this light."""
        points, normals = self._points(depth_m)
        world = points @ T_world_camera.rotation.T + T_world_camera.translation
        facing = normals @ T_world_camera.rotation.T
        light = self._light(world, facing, points, normals)
        albedo = gray if self._kind == "lamp" else self._patches(gray, world)
        other = np.clip(albedo * light, 1.0, 255.0)
        return ((1.0 - self._share) * gray + self._share * other).astype(np.float32)

    def _light(self, world: Array, facing: Array, points: Array, normals: Array) -> Array:
        """Return the brightness (H, W) by lamp, or by sun and torch."""
        if self._kind == "lamp":
            away = self._lamp - world
            distance = np.linalg.norm(away, axis=-1)
            lit = np.abs(np.sum(away * facing, axis=-1)) / distance / np.maximum(distance / LAMP_M, 0.5) ** 2
            return 0.35 + 1.6 * lit
        sun = np.maximum(np.sum(facing * self._sun, axis=-1), 0.15) * self._is_lit(world)
        return 0.30 + 1.0 * sun + 1.1 * torch_light(points, normals)

    def _patches(self, gray: Gray, world: Array) -> Gray:
        """Return the albedo with the contrast of part of the surfaces inverted."""
        vectors, phases = self._waves
        noise = np.sin(world @ vectors.T + phases).sum(axis=-1)
        mean = cv2.GaussianBlur(gray, (0, 0), BLUR_PX)
        is_inverted = noise > np.sqrt(6 / 2) * 0.385  # on 35 % of the surface
        return np.where(is_inverted, 2.0 * mean - gray, gray).astype(np.float32)

    def _points(self, depth_m: Gray) -> tuple[Array, Array]:
        """Return the points (H, W, 3) of an image, holes filled by what is nearest, and normals towards the camera."""
        unknown = np.isnan(depth_m).astype(np.uint8)
        _, label = cv2.distanceTransformWithLabels(unknown, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
        values = np.zeros(label.max() + 1, np.float32)
        values[label[unknown == 0]] = depth_m[unknown == 0]
        depth = cv2.bilateralFilter(cv2.medianBlur(values[label], 5), 9, 0.05, 5.0)
        rays = pixel_rays(CAMERA)
        points = rays / rays[..., 2:] * depth[..., None]
        across, down = np.gradient(points, axis=1), np.gradient(points, axis=0)
        normals = cv2.GaussianBlur(np.cross(down, across) / depth[..., None] ** 2, (0, 0), NORMAL_PX)
        normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-9)
        return points, np.where(np.sum(normals * points, axis=-1, keepdims=True) > 0, -normals, normals)

    def _shadow_map(self, world: Array) -> None:
        """Take down what is nearest to the sun in every cell across its direction."""
        side = np.cross(self._sun, [0.3, 0.5, 0.8])
        side /= np.linalg.norm(side)
        self._axes = np.stack([side, np.cross(self._sun, side), self._sun])
        u, v, height = (world @ self._axes.T).T
        self._corner = np.array([u.min(), v.min()])
        row, column = self._cells(u, v)
        top = np.full((row.max() + 2, column.max() + 2), -1e9, np.float32)
        np.maximum.at(top, (row, column), height)
        self._top = cv2.dilate(top, np.ones((3, 3), np.uint8))

    def _is_lit(self, world: Array) -> Array:
        """Return which points (H, W, 3) the sun reaches."""
        u, v, height = np.moveaxis(world @ self._axes.T, -1, 0)
        row, column = self._cells(u, v)
        row, column = np.clip(row, 0, self._top.shape[0] - 1), np.clip(column, 0, self._top.shape[1] - 1)
        return height > self._top[row, column] - BIAS_M

    def _cells(self, u: Array, v: Array) -> NDArray[np.int_]:
        """Return row and column of places across the direction of the sun."""
        return (np.stack([v - self._corner[1], u - self._corner[0]]) / CELL_M).astype(int)
