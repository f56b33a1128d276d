"""Boards in the world, a rig of cameras that moves before them, and the images it takes: rendered, with known truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3, Camera, Fisheye, Pinhole, so3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.camera import pixel_rays
from sphere_nav.geometry.cameras.rig import T_BODY_OPTICAL, Rig, RigCamera

SUBSAMPLES = 32
OPTICAL = T_BODY_OPTICAL.rotation
BORDER_SQUARES = 1.0  # white paper around the outer squares
BLUR_PX, NOISE = 0.7, 2.0


Seen = TypeVar("Seen")
Board = Any


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
        return [pixel_rays(part.camera) for part in self.rig.cameras]

    def T_camera_board(self, camera: int, instant: int, board: int) -> SE3:
        """Return where a board is for a camera."""
        T_world_camera = self.T_world_rig[instant] @ self.rig.cameras[camera].T_rig_camera
        return T_world_camera.inverse() @ self.T_world_board[board]

    def render(self, camera: int, instant: int, rng: np.random.Generator) -> NDArray[np.uint8]:
        """Return the image (H, W): averaged over each pixel, blurred by the lens, with noise and uneven light."""
        part = self.rig.cameras[camera].camera
        shade = np.linspace(0.75, 1.1, part.width)[None] * np.linspace(1.05, 0.85, part.height)[:, None]
        image: Array = (
            90.0 + 25.0 * np.sin(np.arange(part.width) / 37.0)[None] * np.cos(np.arange(part.height) / 23.0)[:, None]
        )
        for number, board in enumerate(self.boards):
            _draw(image, part, self.rays[camera], board, self.T_camera_board(camera, instant, number))
        image = cv2.GaussianBlur(image * shade, (0, 0), BLUR_PX) + rng.normal(0.0, NOISE, image.shape)
        return np.clip(np.rint(image), 0, 255).astype(np.uint8)

    def views(self, record: Callable[..., Seen], noise_px: float, rng: np.random.Generator) -> list[Seen]:
        """Return what a perfect detector with noise would see, whole boards from the front.

        `record` makes a view of the names of camera, instant and board, of numbers (n,) and pixels (n, 2) of corners.
        """
        found = []
        for camera, part in enumerate(self.rig.cameras):
            for instant in range(len(self.T_world_rig.matrix)):
                for number, board in enumerate(self.boards):
                    T = self.T_camera_board(camera, instant, number)
                    pixels, is_seen = part.camera.project(T.apply(board.points))
                    if is_seen.all() and T.rotation[:, 2] @ T.apply(board.points).mean(axis=0) > 0:
                        noisy = pixels + rng.normal(0.0, noise_px, pixels.shape)
                        found.append(record(part.name, f"{instant:03d}", board.name, np.arange(len(noisy)), noisy))
        return found


def _draw(image: Array, camera: Camera, rays: Array, board: Board, T_camera_board: SE3) -> None:
    """Paint a board; its plane's coordinates are linear within a pixel, so that their slopes give subsamples."""
    T = T_camera_board
    normal = T.rotation[:, 2]
    if normal @ T.translation <= 0.05:
        return  # seen from behind, or edge on
    low, high = np.full(2, -1.0 - BORDER_SQUARES), np.array([board.columns, board.rows]) + BORDER_SQUARES
    box = _box(camera, board, T, low, high)
    if box is None:
        return
    inner = rays[box]
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (normal @ T.translation) / (inner @ normal)
        plane = ((inner * reach[..., None] - T.translation) @ T.rotation[:, :2]) / board.square_m
        plane[~(reach > 0)] = np.nan
    by_v, by_u = np.gradient(plane, axis=0), np.gradient(plane, axis=1)
    squares, paper = pattern(board), (low, high)
    corners = [_levels(squares, plane + dv * by_v + du * by_u, paper) for du in (-0.55, 0.55) for dv in (-0.55, 0.55)]
    level = _levels(squares, plane, paper)
    is_edge = np.any(np.stack(corners) != level, axis=0)
    xy, by_u, by_v = plane[is_edge], by_u[is_edge], by_v[is_edge]
    parts = np.stack([_levels(squares, xy + dv * by_v + du * by_u, paper) for du, dv in _offsets()])
    behind = image[box]
    fine = np.where(parts >= 0, parts, behind[is_edge]).mean(axis=0)
    image[box] = np.where(level >= 0, level, behind)
    image[box][is_edge] = fine


def _box(camera: Camera, board: Board, T: SE3, low: Array, high: Array) -> tuple[slice, slice] | None:
    """Return rows and columns that hold the part of a board that is seen."""
    x, y = (np.linspace(low[axis], high[axis], 60) * board.square_m for axis in (0, 1))
    grid = np.stack([*np.meshgrid(x, y), np.zeros((60, 60))], axis=-1)
    pixels, is_seen = camera.project(T.apply(grid))
    if not is_seen.any():
        return None
    with np.errstate(invalid="ignore"):
        step = np.nanmax(np.abs(np.diff(pixels, axis=0))) + np.nanmax(np.abs(np.diff(pixels, axis=1)))
    margin = int(min(step, 100.0)) + 3
    u, v = pixels[is_seen].T.astype(int)
    rows = slice(max(v.min() - margin, 0), min(v.max() + margin, camera.height))
    return rows, slice(max(u.min() - margin, 0), min(u.max() + margin, camera.width))


def _offsets() -> Array:
    """Return subsamples (n, 2) of a pixel that cut edges of any direction at n different places (R2 sequence)."""
    golden = 1.32471795724474602596
    number = np.arange(1, SUBSAMPLES + 1)[:, None]
    spread: Array = (0.5 + number / golden ** np.array([1.0, 2.0])) % 1.0 - 0.5
    return spread - spread.mean(axis=0)


def pattern(board: Board) -> NDArray[np.bool_]:
    """Return whether a module is dark: (rows + 1, columns + 1, n, n), n modules to the side of a square.

    A ChArUco board has its markers in the white squares; `n` is that of the finest grid that all edges fall on.
    """
    row, column = np.indices((board.rows + 1, board.columns + 1))
    is_dark = (row + column) % 2 == 0  # as OpenCV since 4.6: the outer corner square is dark
    if board.kind != "charuco":
        return is_dark[..., None, None]
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    side = dictionary.markerSize + 2
    margin = (board.square_m / board.marker_m - 1.0) * side / 2.0
    if abs(margin - round(margin)) > 1e-6:
        raise ValueError(f"board {board.name}: expected a margin of whole modules around its markers, found {margin}")
    count = side + 2 * round(margin)
    squares = np.repeat(np.repeat(is_dark[..., None, None], count, axis=-2), count, axis=-1)
    inner = slice(round(margin), round(margin) + side)
    for number, (y, x) in enumerate(np.argwhere(~is_dark)):
        squares[y, x, inner, inner] = dictionary.generateImageMarker(board.first_marker + number, side) < 128
    return squares


def _levels(squares: NDArray[np.bool_], xy: Array, paper: tuple[Array, Array]) -> Array:
    """Return grey levels (...) of points (..., 2) in units of squares from the first corner, -1 beside the paper."""
    xy = np.nan_to_num(xy, nan=-99.0)
    square = np.floor(xy).astype(int)
    module = np.minimum(((xy - square) * squares.shape[-1]).astype(int), squares.shape[-1] - 1)
    x, y = square[..., 0] + 1, square[..., 1] + 1
    is_square = (x >= 0) & (y >= 0) & (x < squares.shape[1]) & (y < squares.shape[0])
    x, y = np.clip(x, 0, squares.shape[1] - 1), np.clip(y, 0, squares.shape[0] - 1)
    level = np.where(is_square & squares[y, x, module[..., 1], module[..., 0]], 35.0, 215.0)
    return np.where(np.all((xy > paper[0]) & (xy < paper[1]), axis=-1), level, -1.0)


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


def boards_around(make, num_boards, distance_m, rng):
    """Return boards on a circle around the origin, facing it, tilted a little; `make` is the class of a board."""
    sizes = [(9, 6), (8, 7), (10, 7), (9, 8), (11, 6), (10, 5)]
    boards, poses = [], []
    for number, size in enumerate(sizes[:num_boards]):
        board = make(f"board{number}", *size, 0.12)
        turn = so3.exp([0.0, 0.0, 2.0 * np.pi * (number + 0.5) / num_boards])
        R = turn @ OPTICAL @ so3.exp(rng.normal(0.0, 0.15, 3))
        center = turn @ [distance_m, 0.0, rng.uniform(-0.15, 0.15)]
        boards.append(board)
        poses.append(SE3.from_parts(R, center - R @ board.points.mean(axis=0)).matrix)
    return tuple(boards), SE3(np.stack(poses))


def wandering(num_instants: int, rng: np.random.Generator, *, is_drive_only: bool = False) -> SE3:
    """Return `T_world_rig` of a rig that is turned and tilted by hand; on a flat floor if `is_drive_only`."""
    poses = []
    for number in range(num_instants):
        if is_drive_only:
            x, y = rng.uniform(-0.5, 0.5, 2)
            poses.append(SE3.from_planar(x, y, rng.uniform(-0.2, 0.2)).matrix)
            continue
        yaw = 2.0 * np.pi * number / num_instants * 3.0 + rng.uniform(-0.2, 0.2)
        R = so3.exp([0.0, 0.0, yaw]) @ so3.exp([*rng.uniform(-0.35, 0.35, 2), 0.0])
        poses.append(SE3.from_parts(R, rng.uniform([-0.5, -0.5, -0.25], [0.5, 0.5, 0.25])).matrix)
    return SE3(np.stack(poses))
