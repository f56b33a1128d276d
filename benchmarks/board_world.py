"""Boards in the world, a rig of cameras that moves before them, and the images it takes: rendered, with known truth."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from rig_calibration.board import Board
from rig_calibration.views import View
from sphere_geometry import SE3, Camera, Fisheye, Pinhole, so3
from sphere_geometry.camera import pixel_grid
from sphere_geometry.rig import Rig, RigCamera

Array = NDArray[np.float64]

SUBSAMPLES = 4
OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
BORDER_SQUARES = 1.0  # white paper around the outer squares
BLUR_PX, NOISE = 0.7, 2.0


@dataclass(frozen=True, eq=False)
class BoardWorld:
    """A rig, boards with `T_world_board`, and `T_world_rig` (I,) of the instants at which all cameras take an image."""

    rig: Rig
    boards: tuple[Board, ...]
    T_world_board: SE3
    T_world_rig: SE3

    @cached_property
    def rays(self) -> list[Array]:
        """Rays (H, W, 3) of every camera."""
        return [part.camera.unproject(pixel_grid(part.camera)) for part in self.rig.cameras]

    def T_camera_board(self, camera: int, instant: int, board: int) -> SE3:
        """Return where a board is for a camera."""
        T_world_camera = self.T_world_rig[instant] @ self.rig.cameras[camera].T_rig_camera
        return T_world_camera.inverse() @ self.T_world_board[board]

    def render(self, camera: int, instant: int, rng: np.random.Generator) -> NDArray[np.uint8]:
        """Return the image (H, W): averaged over each pixel, blurred by the lens, with noise and uneven light."""
        part = self.rig.cameras[camera].camera
        shade = np.linspace(0.75, 1.1, part.width)[None] * np.linspace(1.05, 0.85, part.height)[:, None]
        image = (
            90.0 + 25.0 * np.sin(np.arange(part.width) / 37.0)[None] * np.cos(np.arange(part.height) / 23.0)[:, None]
        )
        for number, board in enumerate(self.boards):
            _draw(image, part, self.rays[camera], board, self.T_camera_board(camera, instant, number))
        image = cv2.GaussianBlur(image * shade, (0, 0), BLUR_PX) + rng.normal(0.0, NOISE, image.shape)
        return np.clip(np.rint(image), 0, 255).astype(np.uint8)

    def views(self, noise_px: float, rng: np.random.Generator) -> list[View]:
        """Return what a perfect detector with noise would see: whole boards, from the front."""
        found = []
        for camera, part in enumerate(self.rig.cameras):
            for instant in range(len(self.T_world_rig.matrix)):
                for number, board in enumerate(self.boards):
                    T = self.T_camera_board(camera, instant, number)
                    pixels, is_seen = part.camera.project(T.apply(board.points))
                    if is_seen.all() and T.rotation[:, 2] @ T.apply(board.points).mean(axis=0) > 0:
                        noisy = pixels + rng.normal(0.0, noise_px, pixels.shape)
                        numbers = np.arange(board.num_corners)
                        found.append(View(part.name, f"{instant:03d}", board.name, numbers, noisy))
        return found


def _draw(image: Array, camera: Camera, rays: Array, board: Board, T_camera_board: SE3) -> None:
    """Paint a chessboard; its plane's coordinates are linear within a pixel, so that their slopes give subsamples."""
    T = T_camera_board
    normal = T.rotation[:, 2]
    if normal @ T.translation <= 0.05:
        return  # seen from behind, or edge on
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (normal @ T.translation) / (rays @ normal)
        plane = ((rays * reach[..., None] - T.translation) @ T.rotation[:, :2]) / board.square_m
        plane[~(reach > 0)] = np.nan
    margin = 1.0 + BORDER_SQUARES
    low, high = -np.array([margin, margin]), np.array([board.columns, board.rows]) - 1.0 + margin
    near = np.all((plane > low - 1.0) & (plane < high + 1.0), axis=-1)
    if not near.any():
        return
    v, u = np.nonzero(near)
    box = (slice(max(v.min() - 2, 0), v.max() + 3), slice(max(u.min() - 2, 0), u.max() + 3))
    part = plane[box]
    by_v, by_u = np.gradient(part, axis=(0, 1)) if min(part.shape[:2]) > 1 else (part * 0, part * 0)
    offsets = (np.arange(SUBSAMPLES) + 0.5) / SUBSAMPLES - 0.5
    level, cover = np.zeros(part.shape[:2]), np.zeros(part.shape[:2])
    for dv in offsets:
        for du in offsets:
            xy = part + dv * by_v + du * by_u
            is_on = np.all((xy > low) & (xy < high), axis=-1)
            is_square = np.all((xy > -1.0) & (xy < high - BORDER_SQUARES), axis=-1)
            is_dark = is_square & (np.floor(np.nan_to_num(xy)).sum(axis=-1) % 2 == 0)
            level += np.where(is_on, np.where(is_dark, 35.0, 215.0), 0.0)
            cover += is_on
    share = cover / SUBSAMPLES**2
    image[box] = level / SUBSAMPLES**2 + (1.0 - share) * image[box]


def vertical_rig(size: tuple[int, int] = (960, 720)) -> Rig:
    """Return three vertical stereo pairs back to back, 30 cm apart, each camera 120 degrees wide (M15 fig. 6b)."""
    width, height = size
    focal = 0.29 * width
    cameras = []
    for sector in range(3):
        for level, up in (("top", 0.15), ("bottom", -0.15)):
            yaw = 2.0 * np.pi * sector / 3.0
            turn = so3.exp([0.0, 0.0, yaw])
            camera = Pinhole(
                width,
                height,
                focal,
                1.002 * focal,
                0.5 * width - 4.3,
                0.5 * height + 3.1,
                (-0.02, 0.004, 1e-4, -2e-4, 0.0),
            )
            T = SE3.from_parts(
                turn @ OPTICAL @ so3.exp([0.01, -0.02, 0.015 * sector]), turn @ [0.06, 0.0, 0.0] + [0, 0, up]
            )
            cameras.append(RigCamera(f"{level}{sector}", camera, T))
    return Rig(tuple(cameras), "vertical")


def ring_rig(size: tuple[int, int] = (960, 720)) -> Rig:
    """Return six diverging fisheye cameras on a ring of 20 cm radius, 60 degrees apart (M15 fig. 6a)."""
    width, height = size
    focal = 0.42 * width
    cameras = []
    for number in range(6):
        turn = so3.exp([0.0, 0.0, np.pi / 3.0 * number])
        camera = Fisheye(
            width, height, focal, 0.999 * focal, 0.5 * width + 5.2, 0.5 * height - 2.7, (0.03, -0.012, 0.004, -0.0006)
        )
        T = SE3.from_parts(turn @ OPTICAL @ so3.exp([-0.02, 0.01, 0.01 * number]), turn @ [0.2, 0.0, 0.0])
        cameras.append(RigCamera(f"cam{number}", camera, T))
    return Rig(tuple(cameras), "ring")


def boards_around(num_boards: int, distance_m: float, rng: np.random.Generator) -> tuple[tuple[Board, ...], SE3]:
    """Return chessboards of different sizes on a circle around the origin, facing it, tilted a little."""
    sizes = [(9, 6), (8, 7), (10, 7), (9, 8), (11, 6), (10, 5)]
    boards, poses = [], []
    for number in range(num_boards):
        columns, rows = sizes[number]
        board = Board(f"board{number}", columns, rows, 0.12)
        turn = so3.exp([0.0, 0.0, 2.0 * np.pi * (number + 0.5) / num_boards])
        R = turn @ OPTICAL @ so3.exp(rng.normal(0.0, 0.15, 3))
        centre = turn @ [distance_m, 0.0, rng.uniform(-0.15, 0.15)]
        boards.append(board)
        poses.append(SE3.from_parts(R, centre - R @ board.points.mean(axis=0)).matrix)
    return tuple(boards), SE3(np.stack(poses))


def wandering(num_instants: int, rng: np.random.Generator, *, is_drive_only: bool = False) -> SE3:
    """Return `T_world_rig` of a rig that is turned and tilted by hand; on a flat floor if `is_drive_only`."""
    poses = []
    for number in range(num_instants):
        if is_drive_only:
            poses.append(SE3.from_planar(*rng.uniform(-0.5, 0.5, 2), rng.uniform(-0.2, 0.2)).matrix)
            continue
        yaw = 2.0 * np.pi * number / num_instants * 3.0 + rng.uniform(-0.2, 0.2)
        R = so3.exp([0.0, 0.0, yaw]) @ so3.exp([*rng.uniform(-0.35, 0.35, 2), 0.0])
        poses.append(SE3.from_parts(R, rng.uniform([-0.5, -0.5, -0.25], [0.5, 0.5, 0.25])).matrix)
    return SE3(np.stack(poses))
