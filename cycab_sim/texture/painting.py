"""Colours of what rays have met: where on its surface, how rough it is there, and what its material makes of that."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cycab_sim.mesh import Mesh
from cycab_sim.noise.kernels import sum_octaves
from cycab_sim.texture.kernels import dress, locate

Floats = NDArray[np.float32]


def paint(
    mesh: Mesh,
    origin: NDArray[np.float64],
    rays: Floats,
    ranges: Floats,
    triangles: NDArray[np.int32],
    cone: Floats,
    colour: Floats,
) -> None:
    """Write the linear colour (N, 3) of rays (N, 3) from one origin; see `locate` and `dress` for the arrays."""
    points, depths = np.empty((8, len(rays)), np.float32), np.empty(len(rays), np.float32)
    seeds, rough = np.empty(len(rays), np.uint32), np.empty(len(rays), np.float32)
    locate(origin, rays, ranges, triangles, cone, mesh.surface_of, mesh.frames, mesh.kinds, points, depths, seeds)
    sum_octaves(points, seeds, rough)
    dress(rays, triangles, mesh.surface_of, mesh.kinds, mesh.params, mesh.colours, points, depths, rough, colour)
