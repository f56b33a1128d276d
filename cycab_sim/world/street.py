"""Ground: the road with its patches, marks and covers, and the raised pavement with its kerb."""

from __future__ import annotations

import numpy as np

from cycab_sim.world import finishes
from cycab_sim.world.mesh import Finish, MeshBuilder, Rectangle, flat
from cycab_sim.world.texture import kernels as k

HALF_ROAD = 3.75  # kerb to centre line, m
PAVEMENT = 2.3  # kerb to wall, m
KERB_HEIGHT = 0.12
KERB_WIDTH = 0.18
FAR = 400.0  # the ground ends here, m


def add_ground(mesh: MeshBuilder, bounds: Rectangle) -> None:
    """Add asphalt as far as the town goes and meadow beyond."""
    x0, y0, x1, y1 = bounds
    road = flat(x0 - 12, y0 - 12, x1 + 12, y1 + 12, 0.0)
    mesh.panels(road, finishes.ASPHALT)
    mesh.panels(flat(x0 - FAR, y0 - FAR, x1 + FAR, y1 + FAR, -0.05), finishes.SOIL)


def add_pavement(mesh: MeshBuilder, block: Rectangle) -> None:
    """Add the raised slab of a block (x0, y0, x1, y1): kerb stones around paving or cobbles."""
    x0, y0, x1, y1 = block
    mesh.box([x0, y0, 0.0], [x1 - x0, y1 - y0, KERB_HEIGHT], finishes.KERB)
    a = KERB_WIDTH
    mesh.panels(flat(x0 + a, y0 + a, x1 - a, y1 - a, KERB_HEIGHT + 0.004), finishes.PAVING)


def add_street(
    mesh: MeshBuilder,
    length: float,
    crossings: tuple[float, ...],
    half: float = HALF_ROAD,
) -> None:
    """Add marks, patches and covers, x along the middle from the start on; crossings are at x = ... m.

    `half` is the distance from the middle to the kerb, m.
    """
    white = (0.60, 0.60, 0.57)
    inner = half + 0.6
    pieces = np.array([0.0, *(x for c in crossings for x in (c - inner - 3.5, c + inner + 3.5)), length]).reshape(-1, 2)
    for x0, x1 in pieces:
        if x1 - x0 > 3.0:
            dashes = Finish(k.MARKING, white, finishes.ASPHALT.color, (0.15, 3.0, 0.5))
            mesh.panels(flat(x0, -0.06, x1, 0.06, 0.006), dashes)
            gutter = Finish(k.PAVING, (0.30, 0.29, 0.27), (0.12, 0.11, 0.10), (0.17, 0.5, 0.3, 0.012, 0.0))
            for y in (-half, half - 0.3):
                mesh.panels(flat(x0 + 3, y, x1 - 3, y + 0.3, 0.004), gutter)
    stripes = Finish(k.MARKING, white, finishes.ASPHALT.color, (0.15, 1.0, 0.5))
    for c in crossings:
        for x in (c - inner - 2.9, c + inner + 0.1):
            mesh.panels(np.roll(flat(x, -half, x + 2.8, half, 0.007), -1, axis=0), stripes)
    _add_patches(mesh, length, half)


def _add_patches(mesh: MeshBuilder, length: float, half: float) -> None:
    """Add repaired asphalt, cobbled strips and covers."""
    rng = mesh.rng
    for _ in range(int(length / 5.0)):
        x, y = rng.uniform(0.0, length), rng.uniform(-half + 0.4, half - 0.8)
        kind = rng.random()
        if kind < 0.55:
            a, b = rng.uniform(0.8, 4.0), min(rng.uniform(0.6, 2.5), half - 0.35 - y)
            mesh.panels(flat(x, y, x + a, y + b, 0.0015 + 0.002 * rng.random()), finishes.TAR)
        elif kind < 0.7:
            mesh.panels(flat(x, -half + 0.3, x + 1.2, half - 0.3, 0.0045), finishes.COBBLES)
        else:
            cover = finishes.slats((0.10, 0.10, 0.105), 0.06)
            mesh.panels(flat(x, y, x + 0.7, y + 0.7, 0.0052), cover)
