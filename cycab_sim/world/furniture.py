"""What stands in a street: parked cars, lamps, traffic signs, bollards, bins, boxes, benches and trees.

Every thing is built around its own origin on the ground, x forward; its builder is placed there (`MeshBuilder.at`).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from cycab_sim.world import finishes
from cycab_sim.world.mesh import BOX_FACES, Finish, MeshBuilder, flat, halved, upright
from sphere_nav.geometry.arrays import Array, Integers

SPRAYS = 220  # leaves around a lump of foliage
LEAVES = 700  # of a hedge, each metre
TWIGS = 26  # of a bare lump
THICK = np.array([0.05, *[0.018] * TWIGS])  # half the width of its branch and of its twigs, m


def add_car(mesh: MeshBuilder) -> None:
    """Add a parked car of about 4.2 m x 1.75 m x 1.5 m, its middle at the origin."""
    rng = mesh.rng
    color = finishes.pick(rng, finishes.CARS)
    body = finishes.painted_metal(color, rng.uniform(0.9, 1.4))
    length, width, tall = rng.uniform(3.7, 4.4), rng.uniform(1.65, 1.78), rng.uniform(0.5, 0.75)
    a, b = length / 2, width / 2
    add_frustum(mesh, (-a, a, b, 0.30), (-a + 0.05, a - 0.05, b, 0.62), body)
    add_frustum(mesh, (-a + 0.05, a - 0.05, b, 0.62), (-a + 0.12, a - 0.18, b - 0.04, 0.90), body)
    cabin_low = (-a + 0.25, a - 1.15, b - 0.06, 0.90)
    cabin_top = (-a + 0.65, a - 1.85, b - 0.22, 0.90 + tall)
    glass = finishes.window(1.2, tall, finishes.darker(color, 0.8), rng, 1, 1)
    add_frustum(mesh, cabin_low, cabin_top, glass)
    add_frustum(mesh, cabin_top, (cabin_top[0] + 0.1, cabin_top[1] - 0.1, cabin_top[2] - 0.08, 0.95 + tall), body)
    for x in (-a + 0.75, a - 0.8):
        for y in (-b, b - 0.2):
            add_wheel(mesh.at(x, y, 0.0, 0.31))
    for x in (-a - 0.01, a - 0.02):
        mesh.box([x, -0.27, 0.42], [0.03, 0.54, 0.12], finishes.sign(0.54, 0.12, rng))
        for y in (-b + 0.08, b - 0.38):
            mesh.box([x, y, 0.60], [0.03, 0.30, 0.14], finishes.painted_metal((0.55, 0.12 if x < 0 else 0.5, 0.1)))


def add_lamp(mesh: MeshBuilder) -> None:
    """Add a street lamp, 5 to 6 m high, its arm over the street (+x)."""
    height = mesh.rng.uniform(4.8, 6.0)
    add_prism(mesh, 0.10, 0.6, finishes.METAL)
    add_prism(mesh, 0.055, height, finishes.METAL)
    mesh.box([-0.03, -0.03, height - 0.08], [1.1, 0.06, 0.08], finishes.METAL)
    mesh.box([0.75, -0.12, height - 0.18], [0.5, 0.24, 0.12], finishes.painted_metal((0.55, 0.55, 0.5)))
    mesh.lamps.append(mesh.place([1.0, 0.0, height - 0.25]))


def add_traffic_sign(mesh: MeshBuilder) -> None:
    """Add a pole with one or two boards that look along +x and -x."""
    rng = mesh.rng
    add_prism(mesh, 0.035, 2.9, finishes.METAL)
    for z in (2.2, 1.55)[: int(rng.integers(1, 3))]:
        mesh.box([-0.02, -0.3, z], [0.04, 0.6, 0.6], finishes.sign(0.6, 0.6, rng, int(rng.integers(1, 3))))


def add_bollard(mesh: MeshBuilder) -> None:
    """Add a bollard with a painted head."""
    add_prism(mesh, 0.07, 0.85, finishes.METAL)
    add_prism(mesh.at(0, 0, 0, 0.85), 0.085, 0.12, finishes.painted_metal(finishes.pick(mesh.rng, finishes.WOODWORK)))


def add_box(mesh: MeshBuilder) -> None:
    """Add a bin, a switch cabinet or a stack of crates."""
    rng = mesh.rng
    kind = rng.random()
    if kind < 0.4:
        mesh.box([-0.3, -0.6, 0], [0.6, 1.2, 1.25], finishes.painted_metal(finishes.pick(rng, finishes.WOODWORK), 0.6))
        mesh.panels(
            [[0.305, -0.5, 0.3], [0.305, 0.5, 0.3], [0.305, 0.5, 1.1], [0.305, -0.5, 1.1]],
            finishes.sign(1.0, 0.8, rng, 4),
        )
    elif kind < 0.7:
        mesh.box([-0.35, -0.3, 0.05], [0.7, 0.6, 0.95], finishes.slats(finishes.pick(rng, finishes.WOODWORK), 0.2))
        mesh.box([-0.38, -0.33, 1.0], [0.76, 0.66, 0.1], finishes.METAL)
    else:
        for level in range(int(rng.integers(1, 4))):
            crate = mesh.at(0, 0, rng.uniform(-0.3, 0.3), 0.4 * level)
            crate.box([-0.3, -0.4, 0.0], [0.6, 0.8, 0.39], finishes.slats((0.36, 0.25, 0.14), 0.13))


def add_bench(mesh: MeshBuilder) -> None:
    """Add a bench that looks along +x."""
    wood = finishes.slats(finishes.pick(mesh.rng, finishes.WOODWORK[2:4]), 0.1)
    mesh.box([-0.2, -0.8, 0.40], [0.42, 1.6, 0.06], wood)
    mesh.box([-0.26, -0.8, 0.55], [0.05, 1.6, 0.40], wood)
    for y in (-0.65, 0.6):
        mesh.box([-0.25, y, 0.0], [0.4, 0.06, 0.42], finishes.METAL)


def add_tree(mesh: MeshBuilder) -> None:
    """Add a tree of 4.5 to 7.5 m: trunk and a crown of rough lumps; of a branch with twigs each where it is bare."""
    rng, day = mesh.rng, mesh.rng.spawn(1)[0]
    height, leaves = rng.uniform(4.5, 7.5), finishes.foliage(rng)
    trunk = 0.45 * height
    add_prism(mesh, rng.uniform(0.11, 0.19), trunk + 0.5, finishes.BARK, is_solid=True)
    mesh.box([-0.6, -0.6, 0.0], [1.2, 1.2, 0.03], finishes.SOIL)
    for _ in range(int(rng.integers(6, 10))):
        spread, radius = 0.17 * height, rng.uniform(0.11, 0.19) * height
        center = np.array([*rng.normal(0.0, 0.55 * spread, 2), trunk + 0.5 + rng.uniform(0.0, 0.40) * height])
        if mesh.season.leaves == "none":
            add_lump(mesh.unseen(), center, radius, leaves)
            _add_branch(mesh.drawn_by(day), trunk + 0.2, center, radius)
        else:
            add_lump(mesh, center, radius, leaves if mesh.season.leaves == "green" else finishes.autumn_leaves(day))


def _add_branch(mesh: MeshBuilder, foot: float, center: Array, radius: float) -> None:
    """Add a branch from a trunk, `foot` m high, to the middle (3,) m of a lump, and twigs from it outward."""
    rng = mesh.rng
    out = rng.normal((0.0, 0.0, 0.5), size=(TWIGS, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    trunk = np.array([[0.0, 0.0, foot]])
    starts = np.concatenate([trunk, trunk + rng.uniform(0.45, 1.0, (TWIGS, 1)) * (center - trunk)])
    ends = np.concatenate([center[None], center + out * radius * rng.uniform(0.6, 1.15, (TWIGS, 1))])
    ring = starts[:, None] + THICK[:, None, None] * (np.eye(3) - 1.0 / 3.0)
    tips = np.broadcast_to(ends[:, None], ring.shape)
    mesh.solid(np.stack([ring, np.roll(ring, -1, axis=1), tips], axis=2).reshape(-1, 3, 3), finishes.BARK)


def add_hedge(mesh: MeshBuilder, length: float) -> None:
    """Add a clipped hedge of 0.8 m x 1.1 m along x from the origin: a dense heart and small leaves all over it."""
    rng = mesh.rng
    leaves, size = finishes.foliage(rng), np.array([length, 0.7, 1.05])
    heart = BOX_FACES * (size - [0.1, 0.1, 0.05]) + [0.05, -0.3, 0.0]
    middles = rng.uniform(0.0, 1.0, (int(LEAVES * length), 1, 3))
    side = rng.integers(0, 5, len(middles))
    for axis, value, number in ((0, 0.0, 0), (0, 1.0, 1), (1, 0.0, 2), (1, 1.0, 3), (2, 1.0, 4)):
        middles[side == number, 0, axis] = value
    sprays = middles * size - [0.0, 0.35, 0.0] + rng.normal(scale=0.035, size=(len(middles), 3, 3))
    mesh.solid(np.concatenate([halved(heart), sprays]), leaves)


def add_monument(mesh: MeshBuilder) -> None:
    """Add a rider of stone on a pedestal with steps, 6 m high."""
    stone = finishes.TRIM
    for i, half in enumerate((2.6, 2.2, 1.8)):
        mesh.box([-half, -half, 0.2 * i], [2 * half, 2 * half, 0.2], finishes.KERB)
    mesh.box([-1.4, -0.9, 0.6], [2.8, 1.8, 2.4], stone)
    mesh.box([-1.5, -1.0, 3.0], [3.0, 2.0, 0.2], stone)
    mesh.panels(upright(-0.8, 0.8, 1.4, 2.4, -0.91), finishes.sign(1.6, 1.0, mesh.rng, 4))
    add_frustum(mesh, (-1.1, 0.9, 0.35, 3.9), (-1.0, 0.9, 0.3, 4.7), finishes.METAL)
    for x in (-1.0, -0.75, 0.45, 0.7):
        add_frustum(
            mesh,
            (x, x + 0.16, 0.08, 3.2),
            (x, x + 0.2, 0.1, 4.0),
            finishes.METAL,
            0.2 if x in (-1.0, 0.45) else -0.2,
        )
    add_frustum(mesh, (0.7, 1.1, 0.14, 4.4), (1.0, 1.5, 0.12, 5.4), finishes.METAL)
    add_frustum(mesh, (-0.25, 0.15, 0.22, 4.7), (-0.25, 0.15, 0.25, 5.5), finishes.METAL)
    add_frustum(mesh, (-0.18, 0.08, 0.12, 5.5), (-0.15, 0.05, 0.1, 5.85), finishes.METAL)


def add_kiosk(mesh: MeshBuilder) -> None:
    """Add a kiosk with eight sides, posters and a roof, 3.6 m high."""
    rng = mesh.rng
    wood = finishes.slats(finishes.pick(rng, finishes.WOODWORK), 0.25)
    add_prism(mesh, 1.7, 2.6, wood)
    add_prism(mesh.at(0, 0, 0, 2.6), 2.1, 0.15, finishes.TRIM)
    add_prism(mesh.at(0, 0, 0, 2.75), 1.2, 0.8, finishes.METAL)
    for turn in np.arange(8) * np.pi / 4 + np.pi / 8:
        side = mesh.at(0, 0, turn).at(1.60, -0.5, np.pi / 2)
        side.panels(upright(0.0, 1.0, 0.8, 2.2, 0.0), finishes.sign(1.0, 1.4, rng, int(rng.integers(2, 7))))


def add_lump(mesh: MeshBuilder, center: Array, radius: float, leaves: Finish) -> None:
    """Add a rough ball of leaves around `center` (3,) m: a dense heart and sprays of leaves all over it."""
    rng = mesh.rng
    (directions, faces), center = _sphere_faces(), mesh.place(center)
    level = radius * (0.85 + 0.25 * rng.uniform(-1.0, 1.0, len(directions)))
    points = center + directions * level[:, None] * np.array([1.0, 1.0, 0.85])
    outward = rng.normal(size=(SPRAYS, 1, 3))
    outward /= np.linalg.norm(outward, axis=2, keepdims=True)
    middles = center + outward * radius * rng.uniform(0.75, 1.15, (SPRAYS, 1, 1)) * np.array([1.0, 1.0, 0.85])
    sprays = middles + rng.normal(scale=0.11, size=(SPRAYS, 3, 3))
    replace(mesh, placement=np.eye(4)).solid(np.concatenate([points[faces], sprays]), leaves)


@cache
def _sphere_faces() -> tuple[Array, Integers]:
    """Return an octahedron split twice: directions (P, 3) and faces (F, 3)."""
    points = np.array([(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], np.float64)
    faces = np.array([(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4), (1, 0, 5), (2, 1, 5), (3, 2, 5), (0, 3, 5)])
    for _ in range(2):
        corners = points[faces]
        middles = (corners + np.roll(corners, -1, axis=1)).reshape(-1, 3)  # of ab, bc, ca
        middles /= np.linalg.norm(middles, axis=1, keepdims=True)
        every = np.concatenate([points, middles])
        _, first, number = np.unique(every, axis=0, return_index=True, return_inverse=True)
        points, rank = every[np.sort(first)], np.argsort(np.argsort(first))  # in the order in which they come
        ab, bc, ca = rank[number.ravel()[-len(middles) :]].reshape(-1, 3).T
        a, b, c = faces.T
        faces = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 3)
    return points, faces


def add_frustum(
    mesh: MeshBuilder,
    low: tuple[float, float, float, float],
    top: tuple[float, float, float, float],
    finish: Finish,
    y: float = 0.0,
) -> None:
    """Add a hull between two rectangles (x0, x1, half width, z) around a line y m to the left, without its floor."""
    p = np.concatenate([flat(x0, -half, x1, half, z) for x0, x1, half, z in (low, top)])
    p[:, 1] += y
    sides = p[[[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7], [4, 5, 6, 7]]]
    mesh.panels(sides, finish)


def add_prism(mesh: MeshBuilder, radius: float, height: float, finish: Finish, is_solid: bool = False) -> None:
    """Add an upright prism of eight sides with both ends; `is_solid`: one texture in space instead of one a side."""
    angle = np.arange(9) * np.pi / 4
    low = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.0 * angle], axis=1)
    top = low + np.array([0.0, 0.0, height])
    sides = np.stack([low[:-1], low[1:], top[1:], top[:-1]], axis=1)
    quads = np.concatenate([sides, _fan(top), _fan(low)[:, [0, 3, 2, 1]]])
    if is_solid:
        mesh.solid(halved(quads), finish)
    else:
        mesh.panels(quads, finish)


def _fan(ring: Array) -> Array:
    """Return four quadrilaterals (4, 4, 3) that fill a closed ring (9, 3) of eight corners."""
    middle = np.broadcast_to(ring[:-1].mean(axis=0), (4, 3))
    return np.stack([middle, ring[0:8:2], ring[1:8:2], ring[2:9:2]], axis=1)


def add_wheel(mesh: MeshBuilder) -> None:
    """Add a wheel of 0.31 m radius and 0.2 m width whose axle is y."""
    lying = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    add_prism(mesh.within(lying), 0.31, 0.2, finishes.RUBBER)
    add_prism(mesh.at(0.0, -0.006).within(lying), 0.17, 0.212, finishes.METAL)
