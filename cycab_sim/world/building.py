"""Houses: fronts with windows in relief, ledges, doors, shops and signs; roofs and chimneys.

A front is built in its own frame: x along the wall, y into the house, z up; the wall is y = 0, the street y < 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cycab_sim.world import finishes
from cycab_sim.world.finishes import Color
from cycab_sim.world.mesh import REVEAL, Finish, MeshBuilder, Rectangle, upright
from cycab_sim.world.texture import kernels as k
from sphere_nav.geometry.arrays import Array

GROUND_STOREY = 3.6


@dataclass(frozen=True)
class Style:
    """What the fronts of one house share."""

    wall: Finish
    frame: Color
    shutter: Color | None
    bay: float
    window: tuple[float, float]
    storey: float
    reveal: float
    has_ledges: bool
    is_shop: bool


def _random_style(rng: np.random.Generator) -> Style:
    """Draw the style of a house."""
    return Style(
        wall=finishes.wall(rng),
        frame=finishes.pick(rng, finishes.WOODWORK),
        shutter=finishes.pick(rng, finishes.WOODWORK) if rng.random() < 0.4 else None,
        bay=rng.uniform(2.3, 3.2),
        window=(rng.uniform(0.95, 1.3), rng.uniform(1.4, 1.9)),
        storey=rng.uniform(2.9, 3.3),
        reveal=rng.uniform(0.12, 0.25),
        has_ledges=bool(rng.random() < 0.7),
        is_shop=bool(rng.random() < 0.45),
    )


def add_house(mesh: MeshBuilder, width: float, depth: float, storeys: int) -> None:
    """Add a house; its lower left front corner is the origin, x along the front, y into the house."""
    rng = mesh.rng
    style = _random_style(rng)
    height = GROUND_STOREY + (storeys - 1) * style.storey + 0.5
    _add_front(mesh, width, height, storeys, style)
    for x, y, turn, length in ((width, 0.0, 90, depth), (width, depth, 180, width), (0.0, depth, 270, depth)):
        _add_plain_wall(mesh.at(x, y, np.radians(turn)), length, height, style)
    add_roof = _add_gable_roof if rng.random() < 0.6 else _add_flat_roof
    add_roof(mesh, (width, depth, height), style.wall)


def _add_front(mesh: MeshBuilder, width: float, height: float, storeys: int, style: Style) -> None:
    num_bays = max(1, int(width / style.bay))
    centers, half = (np.arange(num_bays) + 0.5) * width / num_bays, style.window[0] / 2
    shop = (0.4 * width / num_bays, 0.45) if style.is_shop else (half, 0.95)
    door = int(mesh.rng.integers(num_bays))
    _add_openings(mesh, width, GROUND_STOREY, centers, shop[0], [(shop[1], 2.7)], style, door)
    upper = GROUND_STOREY + np.arange(storeys - 1) * style.storey + 0.8
    rows = [(low - GROUND_STOREY, low + style.window[1] - GROUND_STOREY) for low in upper]
    above = mesh.at(0.0, 0.0, 0.0, GROUND_STOREY)
    _add_openings(above, width, height - GROUND_STOREY, centers, half, rows, style)
    _add_trims(mesh, width, height, storeys, style)


def _add_openings(
    mesh: MeshBuilder, width: float, height: float, centers: Array, half: float,
    rows: list[tuple[float, float]], style: Style, door: int = -1,
) -> None:  # fmt: skip
    """Add a wall with a grid of windows of `half` their width, one of them replaced by a door in the lowest row."""
    left, right = centers - half, centers + half
    x = np.sort(np.concatenate([[0.0, width], left, right]))
    z = np.sort(np.concatenate([[0.0, height], np.ravel(rows)]))
    solid = []
    for i in range(len(x) - 1):
        for j in range(len(z) - 1):
            is_hole = j % 2 == 1 or (j == 0 and i == 2 * door + 1)  # a window, or the door down to the ground
            if i % 2 == 0 or not is_hole:
                solid.append(upright(x[i], x[i + 1], z[j], z[j + 1], 0.0))
    mesh.sheet(solid, style.wall, [[0, 0, 0], [1, 0, 0], [0, 0, 1]])
    for j, (low, high) in enumerate(rows):
        for i in range(len(left)):
            is_door = j == 0 and i == door
            _add_opening(mesh, (left[i], right[i], 0.0 if is_door else low, high), style, is_door)


def _add_opening(
    mesh: MeshBuilder,
    hole: Rectangle,
    style: Style,
    is_door: bool,
) -> None:
    """Add the reveal, pane or door, sill and shutters of a hole (x0, x1, z0, z1)."""
    x0, x1, z0, z1 = hole
    r = style.reveal
    w, h = x1 - x0, z1 - z0
    mesh.panels([x0, 0.0, z0] + REVEAL * [w, r, h], finishes.TRIM)
    leaf = Finish(k.WOOD, style.frame, finishes.darker(style.frame, 0.4), (0.14, w, h))
    across, up = 2 if w < 1.6 else 3, 2 if h < 1.8 else 3
    pane = leaf if is_door else finishes.window(w, h, style.frame, mesh.rng, across, up)
    mesh.panels(upright(x0, x1, z0, z1, r), pane)
    mesh.box([x0 - 0.08, -0.05, z1], [w + 0.16, 0.06, 0.14], finishes.TRIM)
    if is_door:
        mesh.box([x0 - 0.1, -0.35, 0.0], [w + 0.2, 0.35, 0.14], finishes.KERB)
        return
    mesh.box([x0 - 0.1, -0.12, z0 - 0.08], [w + 0.2, 0.13, 0.08], finishes.TRIM)
    if style.shutter is not None and w < 1.5:
        for x in (x0 - w / 2 - 0.02, x1 + 0.02):
            mesh.box([x, -0.045, z0], [w / 2, 0.045, h], finishes.slats(style.shutter, 0.07))


def _add_trims(mesh: MeshBuilder, width: float, height: float, storeys: int, style: Style) -> None:
    rng = mesh.rng
    mesh.box([-0.1, -0.3, height - 0.25], [width + 0.2, 0.3, 0.25], finishes.TRIM)
    mesh.box([0.03, -0.11, 0.0], [0.1, 0.1, height - 0.25], finishes.METAL)
    if style.has_ledges:
        for i in range(storeys - 1):
            mesh.box([0.0, -0.08, GROUND_STOREY + i * style.storey + 0.05], [width, 0.08, 0.16], finishes.TRIM)
    if style.is_shop:
        w, h = width * rng.uniform(0.45, 0.8), rng.uniform(0.45, 0.7)
        x = rng.uniform(0.15, width - w - 0.1)
        mesh.box([x, -0.1, 2.85], [w, 0.1, h], finishes.sign(w, h, rng))
        if rng.random() < 0.6:
            _add_awning(mesh, width, finishes.slats(finishes.pick(rng, finishes.WOODWORK), 0.3))
        y = rng.uniform(0.5, 0.8)
        mesh.box([width - 0.6, -y - 0.1, 3.6], [0.08, y, 0.6], finishes.sign(y, 0.6, rng, 2))
    elif rng.random() < 0.5:
        x = rng.uniform(0.3, width - 1.9)
        mesh.box([x, -0.9, GROUND_STOREY + 0.02], [1.7, 0.9, 0.12], finishes.TRIM)
        mesh.box([x, -0.9, GROUND_STOREY + 0.14], [1.7, 0.05, 0.75], finishes.slats(style.frame, 0.12))


def _add_awning(mesh: MeshBuilder, width: float, cloth: Finish) -> None:
    top, low, out = 2.82, 2.4, -0.8
    slope = [[0.2, out, low], [width - 0.2, out, low], [width - 0.2, 0.0, top], [0.2, 0.0, top]]
    hem = [[0.2, out, low - 0.2], [width - 0.2, out, low - 0.2], [width - 0.2, out, low], [0.2, out, low]]
    mesh.panels([slope, hem], cloth)


def _add_plain_wall(mesh: MeshBuilder, width: float, height: float, style: Style) -> None:
    """Add a wall with few openings: pasted posters and a vent, no relief."""
    rng = mesh.rng
    mesh.panels(upright(0.0, width, 0.0, height, 0.0), style.wall)
    for _ in range(int(width / 3.0)):
        w, h = rng.uniform(0.6, 1.6), rng.uniform(0.6, 1.4)
        x, z = rng.uniform(0.2, max(0.3, width - w - 0.2)), rng.uniform(0.4, 2.2)
        poster = finishes.sign(w, h, rng, int(rng.integers(2, 6)))
        mesh.panels(upright(x, x + w, z, z + h, -0.01 - 0.01 * rng.random()), poster)
    for z in np.arange(GROUND_STOREY + 0.8, height - 1.8, style.storey):
        x = rng.uniform(0.5, max(0.6, width - 1.5))
        mesh.panels(upright(x, x + 0.9, z, z + 1.3, -0.02), finishes.window(0.9, 1.3, style.frame, rng))


def _add_gable_roof(mesh: MeshBuilder, size: tuple[float, float, float], wall: Finish) -> None:
    rng = mesh.rng
    width, depth, height = size
    ridge = height + depth * rng.uniform(0.28, 0.42)
    tiles = Finish(k.ROOF, finishes.pick(rng, finishes.ROOFS), (0.16, 0.13, 0.10), (0.15,))
    middle, eave = depth / 2, -0.35
    drop = height - (ridge - height) / middle * 0.35
    front = [[-0.1, eave, drop], [width + 0.1, eave, drop], [width + 0.1, middle, ridge], [-0.1, middle, ridge]]
    right = [[width, 0, height], [width, depth, height], [width, middle, ridge], [width, middle, ridge]]
    for side, finish in ((np.array(front), tiles), (np.array(right), wall)):
        mesh.panels([side, [width, depth, 0.0] + side * [-1.0, -1.0, 1.0]], finish)  # and turned to the back
    _add_chimney(mesh, width, middle, ridge - 0.4)


def _add_flat_roof(mesh: MeshBuilder, size: tuple[float, float, float], wall: Finish) -> None:
    width, depth, height = size
    mesh.box([0, 0, height - 0.1], [width, depth, 0.1], finishes.ROOF_FLAT)
    for low, extent in (
        ([0, 0, height], [width, 0.25, 0.6]),
        ([0, depth - 0.25, height], [width, 0.25, 0.6]),
        ([0, 0.25, height], [0.25, depth - 0.5, 0.6]),
        ([width - 0.25, 0.25, height], [0.25, depth - 0.5, 0.6]),
    ):
        mesh.box(low, extent, wall)
    _add_chimney(mesh, width, depth / 2, height)


def _add_chimney(mesh: MeshBuilder, width: float, y: float, z: float) -> None:
    rng = mesh.rng
    brick = Finish(k.BRICK, finishes.pick(rng, finishes.BRICKS), (0.46, 0.42, 0.36), (0.15, 0.23, 0.075, 0.012, 0.5))
    x = rng.uniform(0.5, width - 1.5)
    mesh.box([x, y - 0.3, z], [0.9, 0.6, 1.5], brick)
    mesh.box([x - 0.06, y - 0.36, z + 1.5], [1.02, 0.72, 0.12], finishes.TRIM)
