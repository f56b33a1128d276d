"""What moves: cars, a tram, pedestrians, cyclists, each of a few rigid parts that swing or roll as it goes.

A part is built around the place of its figure on the ground, x forward; see `traffic.py` for how it is put there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cycab_sim.world import finishes
from cycab_sim.world.finishes import Color
from cycab_sim.world.furniture import add_car, add_frustum, add_prism, add_wheel
from cycab_sim.world.mesh import Finish, Mesh, MeshBuilder, placed, upright
from cycab_sim.world.texture import kernels as k
from sphere_nav.geometry.arrays import Array

CLOTHES: tuple[Color, ...] = (
    (0.05, 0.06, 0.12), (0.30, 0.05, 0.06), (0.45, 0.42, 0.36), (0.06, 0.06, 0.06),
    (0.10, 0.22, 0.30), (0.34, 0.28, 0.08), (0.12, 0.20, 0.10), (0.52, 0.50, 0.50),
)  # fmt: skip
SKINS: tuple[Color, ...] = ((0.50, 0.33, 0.24), (0.36, 0.22, 0.14), (0.16, 0.09, 0.06))
HAIR: tuple[Color, ...] = ((0.05, 0.04, 0.03), (0.16, 0.09, 0.04), (0.32, 0.24, 0.12), (0.30, 0.29, 0.28))
STRIDE = 1.45  # m, two steps
WHEEL = 0.33  # radius of a bicycle's wheel, m
SECTIONS, SECTION, GAP = 3, 6.6, 0.35  # of the tram, m


@dataclass(frozen=True, eq=False)
class RigidPart:
    """A rigid piece that leads `ahead` m of its figure's middle, with its two supports `base` m apart.

    It turns about the y axis through `pivot` (3,) by swing * sin(wave * way + phase) + roll * way, way in m.
    """

    mesh: Mesh
    ahead: float = 0.0
    base: float = 0.5
    pivot: tuple[float, float, float] = (0.0, 0.0, 0.0)
    swing: float = 0.0
    wave: float = 0.0
    phase: float = 0.0
    roll: float = 0.0


@dataclass(frozen=True)
class Figure:
    """Parts, and the room they take: to the front and back of the middle, and to the sides, m."""

    parts: tuple[RigidPart, ...]
    half_length: float
    half_width: float


def make_car(rng: np.random.Generator) -> Figure:
    """Return a car, as those that are parked."""
    return Figure((RigidPart(_built(rng, add_car), base=2.5),), 2.2, 0.9)


def make_tram(rng: np.random.Generator) -> Figure:
    """Return a tram of three sections that follow the bends one after the other."""
    color, step = finishes.pick(rng, finishes.WOODWORK), SECTION + GAP
    parts = [RigidPart(_built(rng, _add_section, i - 1, color), (1 - i) * step, 4.4) for i in range(SECTIONS)]
    return Figure(tuple(parts), SECTIONS * step / 2, 1.2)


def make_pedestrian(rng: np.random.Generator) -> Figure:
    """Return somebody who walks."""
    tall = rng.uniform(0.92, 1.07)
    cloth, trousers, skin = _dressed(rng)
    hip, shoulder, phase, wave = 0.88 * tall, 1.42 * tall, rng.uniform(0.0, 6.28), 2 * np.pi / STRIDE
    has_bag = rng.random() < 0.4

    def body(mesh: MeshBuilder) -> None:
        _add_body(mesh, tall, cloth, trousers, skin)
        if has_bag:
            mesh.box([-0.32, -0.15, 1.02 * tall], [0.18, 0.3, 0.42], _cloth(finishes.pick(rng, CLOTHES)))

    parts = [RigidPart(_built(rng, body), base=0.3)]
    for side in (-1.0, 1.0):
        leg = _built(rng, _add_leg, 0.1 * side, hip, trousers)
        arm = _built(rng, _add_arm, 0.25 * side, shoulder, tall, cloth, skin)
        turn = phase + (np.pi if side > 0 else 0.0)
        parts.append(RigidPart(leg, base=0.3, pivot=(0.0, 0.0, hip), swing=0.42, wave=wave, phase=turn))
        parts.append(RigidPart(arm, base=0.3, pivot=(0.0, 0.0, shoulder), swing=0.35, wave=wave, phase=turn + np.pi))
    return Figure(tuple(parts), 0.35, 0.3)


def make_cyclist(rng: np.random.Generator) -> Figure:
    """Return somebody on a bicycle whose wheels turn."""
    paint = finishes.painted_metal(finishes.pick(rng, finishes.WOODWORK))
    cloth, trousers, skin = _dressed(rng)

    def frame(mesh: MeshBuilder) -> None:
        for low, size in (
            ([-0.5, -0.02, 0.30], [0.5, 0.04, 0.04]), ([-0.15, -0.02, 0.30], [0.04, 0.04, 0.62]),
            ([-0.12, -0.02, 0.76], [0.55, 0.04, 0.04]), ([0.42, -0.02, 0.35], [0.05, 0.04, 0.70]),
            ([0.40, -0.26, 1.02], [0.04, 0.52, 0.04]), ([-0.27, -0.09, 0.92], [0.26, 0.18, 0.06]),
        ):  # fmt: skip
            mesh.box(low, size, paint)
        lean = mesh.at(-0.12, 0.0, 0.0, 0.08).within(_pitch(0.35, (0.0, 0.0, 0.88)))
        _add_body(lean, 1.0, cloth, trousers, skin)
        for side in (-1.0, 1.0):
            mesh.box([0.08, 0.22 * side - 0.05, 1.06], [0.36, 0.09, 0.09], cloth)

    parts = [RigidPart(_built(rng, frame), base=1.0)]
    for x in (-0.5, 0.52):
        wheel = _built(rng, _add_spoked_wheel, x)
        parts.append(RigidPart(wheel, base=1.0, pivot=(x, 0.0, WHEEL), roll=1.0 / WHEEL))
    for side in (-1.0, 1.0):
        leg = _built(rng, _add_leg, 0.1 * side, 0.95, trousers, 0.72)
        phase = np.pi if side > 0 else 0.0
        parts.append(RigidPart(leg, 0.0, 1.0, (-0.1, 0.0, 0.95), swing=0.35, wave=1.2, phase=phase))
    return Figure(tuple(parts), 0.95, 0.35)


def _built(rng: np.random.Generator, add: Callable[..., None], *arguments: Any) -> Mesh:
    """Return the mesh of what `add(mesh, *arguments)` adds."""
    mesh = MeshBuilder(rng, is_clutter=True)
    add(mesh, *arguments)
    return mesh.build()


def _dressed(rng: np.random.Generator) -> list[Finish]:
    """Return somebody's jacket, trousers and skin."""
    return [_cloth(finishes.pick(rng, some)) for some in (CLOTHES, CLOTHES, SKINS)]


def _cloth(color: Color) -> Finish:
    return Finish(k.SOIL, color, finishes.darker(color, 0.55), (0.16,))


def _pitch(angle: float, pivot: tuple[float, float, float]) -> Array:
    """Return the matrix (4, 4) of a turn about y through a pivot; positive leans forward."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]])
    return placed(*pivot[:2], 0.0, pivot[2]) @ turn @ placed(-pivot[0], -pivot[1], 0.0, -pivot[2])


def _add_body(mesh: MeshBuilder, tall: float, cloth: Finish, trousers: Finish, skin: Finish) -> None:
    """Add hips, chest, neck, head and hair."""
    h = tall
    add_frustum(mesh, (-0.11, 0.11, 0.16, 0.84 * h), (-0.11, 0.11, 0.15, 1.0 * h), trousers)
    add_frustum(mesh, (-0.12, 0.12, 0.16, 0.98 * h), (-0.12, 0.13, 0.22, 1.38 * h), cloth)
    add_frustum(mesh, (-0.12, 0.13, 0.22, 1.38 * h), (-0.06, 0.06, 0.08, 1.47 * h), cloth)
    add_prism(mesh.at(0.01, 0.0, 0.0, 1.45 * h), 0.055, 0.09, skin, is_solid=True)
    add_frustum(mesh, (-0.08, 0.09, 0.06, 1.51 * h), (-0.10, 0.10, 0.085, 1.62 * h), skin)
    hair = _cloth(finishes.pick(mesh.rng, HAIR))
    add_frustum(mesh, (-0.105, 0.10, 0.09, 1.62 * h), (-0.07, 0.05, 0.06, 1.72 * h), hair)
    mesh.box([-0.115, -0.08, 1.52 * h], [0.06, 0.16, 0.12], hair)


def _add_leg(mesh: MeshBuilder, y: float, hip: float, trousers: Finish, length: float = 0.0) -> None:
    """Add a leg with its shoe; `length` m from the hip to the ground, to the very ground without one."""
    foot = hip - length if length else 0.0
    add_frustum(mesh, (-0.05, 0.06, 0.06, foot + 0.08), (-0.08, 0.09, 0.085, hip), trousers, y)
    mesh.box([-0.08, y - 0.05, foot], [0.25, 0.1, 0.09], _cloth((0.05, 0.045, 0.04)))


def _add_arm(mesh: MeshBuilder, y: float, shoulder: float, tall: float, cloth: Finish, skin: Finish) -> None:
    low = shoulder - 0.56 * tall
    add_frustum(mesh, (-0.04, 0.05, 0.04, low), (-0.06, 0.06, 0.055, shoulder), cloth, y)
    mesh.box([-0.035, y - 0.035, low - 0.11], [0.08, 0.07, 0.12], skin)


def _add_spoked_wheel(mesh: MeshBuilder, x: float) -> None:
    """Add a tyre of 16 pieces, and eight spokes to its middle."""
    for number in range(16):
        piece = mesh.within(_pitch(number * np.pi / 8, (x, 0.0, WHEEL)))
        piece.box([x - 0.066, -0.02, 0.0], [0.132, 0.04, 0.045], finishes.RUBBER)
        if number % 2:
            piece.box([x - 0.006, -0.006, 0.03], [0.012, 0.012, WHEEL - 0.03], finishes.METAL)


def _add_section(mesh: MeshBuilder, place: int, color: Color) -> None:
    """Add a section of the tram: place -1 at the front, 0 in the middle, 1 at the back."""
    front, back = SECTION / 2, -SECTION / 2
    body, glass = finishes.painted_metal(color, 1.1), finishes.window(1.1, 1.2, (0.07, 0.07, 0.08), mesh.rng, 1, 1)
    nose, tail = (0.5 if place < 0 else 0.0), (0.5 if place > 0 else 0.0)
    add_frustum(mesh, (back + tail / 2, front - nose / 2, 1.16, 0.28), (back, front, 1.2, 1.0), body)
    x = np.arange(back, front - 1.0, 1.1)
    for side in (-1.0, 1.0):
        for left in x:
            y, ends = 1.2 * side, (left, left + 1.1) if side < 0 else (left + 1.1, left)
            mesh.panels(upright(*ends, 1.0, 2.5, y), glass)
    add_frustum(mesh, (back, front, 1.19, 1.0), (back + tail, front - nose, 1.19, 2.55), glass)
    add_frustum(mesh, (back + tail, front - nose, 1.2, 2.5), (back + tail, front - nose, 1.1, 3.1), body)
    mesh.box([-1.2, -0.7, 3.1], [2.2, 1.4, 0.25], finishes.METAL)
    for axle in (-2.2, 2.2):
        for y in (-0.95, 0.75):
            add_wheel(mesh.at(axle, y, 0.0, 0.31))
    if place < 1:  # the bellows towards the next section
        mesh.box([back - GAP, -1.05, 0.4], [GAP, 2.1, 2.5], Finish(k.SLATS, (0.05, 0.05, 0.055), params=(0.14, 0.5)))
