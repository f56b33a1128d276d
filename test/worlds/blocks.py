"""Random pixels in blocks, and few lines of NumPy that say what the kernels shall find of them."""

from __future__ import annotations

import numpy as np

from sphere_nav.geometry import SE3
from sphere_nav.photometric.align.iteration import kernels
from sphere_nav.photometric.pixels.pyramid import Level, kernel_camera, kernel_motion


def points_before(camera, rng, number=1500):
    """Random points (M, 3) m that the camera sees."""
    pixels = np.stack([rng.uniform(0, camera.width - 1, number), rng.uniform(0, camera.height - 1, number)], axis=-1)
    rays = camera.unproject(pixels)
    rays = rays[~np.isnan(rays[:, 0])]
    return rays * rng.uniform(0.5, 20.0, (len(rays), 1))


class Case:
    """A random reference, seen from nearby by a camera with a random image."""

    def __init__(self, rng, camera, number=3000, dtype=np.float32):
        self.camera = camera
        points = points_before(camera, rng, number)
        self.number = len(points)
        intensity = rng.uniform(0, 255, self.number).astype(np.float32)
        gradient = (rng.normal(size=(3, self.number)) * 50).astype(np.float32)
        self.image = rng.uniform(0, 255, (camera.height, camera.width)).astype(dtype)
        self.level = Level(self.image, camera, 0)
        self.blocks = in_blocks(np.vstack([points.T, intensity, gradient]).astype(np.float32))
        self.T = SE3.exp([0.05, -0.03, 0.04, 0.01, -0.02, 0.015])
        self.data = rows(self.blocks, kernels.BLOCK)  # (7, N') with the filling

    @property
    def arguments(self):
        """T, camera and image as the kernels take them."""
        return kernel_motion(self.T.matrix), kernel_camera(self.camera), self.level.samples

    def twin(self, gain=1.0, bias=0.0):
        """Return visible (N',) bool, residual (N',), columns J (N', 8) f64 by the paper; NaN where not visible."""
        points = self.data[:3].T.astype(np.float64)
        moved = self.T.apply(points)
        pixels, _ = self.camera.project(moved)
        size = (self.camera.width - 1, self.camera.height - 1)
        with np.errstate(invalid="ignore"):
            visible = np.all((pixels >= 0) & (pixels < size), axis=-1)
        gray, g = np.full(len(points), np.nan), np.full((len(points), 2), np.nan)
        gray[visible], g[visible] = bilinear(self.image.astype(np.float64), pixels[visible])
        by_point = gain * np.einsum("ni,nij->nj", g, self.camera.J_project(moved)) @ self.T.rotation
        b = 0.5 * (self.data[4:].T + by_point)  # eq. 30
        J = np.column_stack([b, np.cross(points, b), gray, np.ones(len(points))])
        return visible, gain * gray + bias - self.data[3], J


def in_blocks(pixels):
    """Return the blocks of pixels (7, N): points, grey levels, gradients; filled up with what nobody sees."""
    number = -(-pixels.shape[1] // kernels.SIDE) * kernels.SIDE
    filled = np.zeros((7, number), np.float32)
    filled[2] = np.nan
    filled[:, : pixels.shape[1]] = pixels
    return np.ascontiguousarray(filled.reshape(7, -1, kernels.SIDE).transpose(1, 0, 2)).reshape(-1)


def rows(flat, size):
    """Return the rows of all blocks of a flat array, each in one piece."""
    blocks = flat.reshape(-1, size // kernels.SIDE, kernels.SIDE)
    return np.ascontiguousarray(blocks.transpose(1, 0, 2)).reshape(size // kernels.SIDE, -1)


def bilinear(image, pixels):
    """Return grey levels (N,) and their derivatives (N, 2) at pixels (N, 2)."""
    u, v = pixels.T
    iu, iv = np.floor(u).astype(int), np.floor(v).astype(int)
    du, dv = u - iu, v - iv
    a, b, c, d = image[iv, iu], image[iv, iu + 1], image[iv + 1, iu], image[iv + 1, iu + 1]
    gray = (1 - dv) * ((1 - du) * a + du * b) + dv * ((1 - du) * c + du * d)
    gradient = np.stack([(1 - dv) * (b - a) + dv * (d - c), (1 - du) * (c - a) + du * (d - b)], axis=-1)
    return gray, gradient
