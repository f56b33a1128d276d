"""What the sun does not reach: a map of how far along its rays the first surface lies that stands still."""

from __future__ import annotations

from threading import Lock

import numpy as np

from cycab_sim.rendering.embree import PacketScene
from sphere_nav.geometry.arrays import Array, Floats

REACH = 400.0  # the sun's rays start this far away, m


class ShadowMap:
    """Depths (K, K) f32 m along the sun's rays, seen from the sun; see `kernels.light` for how it is used.

    It covers a square of (side m, texel m) around `center` (3,) m, beyond which nothing casts a shadow.
    `sun`: the unit vector (3,) towards the sun.
    """

    def __init__(self, scene: PacketScene, square: tuple[float, float], sun: Array, center: Array) -> None:
        extent, self.texel = square
        self._size = int(extent / self.texel)
        self._scene, self._center = scene, center
        self._lock = Lock()
        self.T_sun_world = _shadow_frame(sun)
        self.corner = self.T_sun_world[:2] @ center - 0.5 * self._size * self.texel
        self._depths: Floats | None = None

    @property
    def depths(self) -> Floats:
        """Depths without what moves; cast when they are asked for, since a world without pictures needs none."""
        with self._lock:
            if self._depths is None:
                self._depths = self._cast()
            return self._depths

    def _cast(self) -> Floats:
        R, texel, size, corner = self.T_sun_world, self.texel, self._size, self.corner
        depth = np.empty((size, size), np.float32)
        columns = corner[0] + texel * np.arange(size)
        direction = R[2:].astype(np.float32)
        base = float(R[2] @ self._center) - REACH
        for row in range(size):
            local = np.stack([columns, np.full(size, corner[1] + texel * row), np.full(size, base)], axis=1)
            starts = (local @ R).astype(np.float32)
            _, far = self._scene.cast(starts, np.repeat(direction, size, axis=0))
            depth[row] = base + far
        return depth


def _shadow_frame(sun: Array) -> Array:
    """Return rows x, y across the sun's rays and z along them, (3, 3)."""
    x = np.cross([0.0, 0.0, 1.0], sun)
    norm = np.linalg.norm(x)
    x = x / norm if norm > 1e-6 else np.array([1.0, 0.0, 0.0])
    return np.stack([x, np.cross(-sun, x), -sun])
