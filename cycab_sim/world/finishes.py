"""Palettes of the town: linear reflectances of walls, roofs, woodwork, cars, and the finishes made of them."""

from __future__ import annotations

import numpy as np

from cycab_sim.world.mesh import Finish
from cycab_sim.world.texture import kernels as k

Color = tuple[float, float, float]

ASPHALT = Finish(k.ASPHALT, (0.130, 0.128, 0.126), (0.20, 0.19, 0.18), (0.21,))
TAR = Finish(k.ASPHALT, (0.075, 0.075, 0.078), (0.12, 0.115, 0.11), (0.23,))
PAVING = Finish(k.PAVING, (0.34, 0.32, 0.29), (0.17, 0.16, 0.14), (0.15, 0.60, 0.40, 0.012, 0.5))
COBBLES = Finish(k.PAVING, (0.25, 0.23, 0.21), (0.11, 0.10, 0.09), (0.17, 0.14, 0.12, 0.014, 0.5))
KERB = Finish(k.STONE, (0.40, 0.39, 0.36), (0.18, 0.17, 0.16), (0.17, 1.0, 0.5, 0.01, 0.0))
TRIM = Finish(k.STONE, (0.52, 0.48, 0.41), (0.30, 0.27, 0.22), (0.16, 1.3, 0.9, 0.008, 0.0))
SOIL = Finish(k.SOIL, (0.10, 0.13, 0.05), (0.20, 0.16, 0.10), (0.20,))
BARK = Finish(k.BARK, (0.17, 0.13, 0.10), (0.1, 0.1, 0.1), (0.30,))
METAL = Finish(k.METAL, (0.20, 0.21, 0.22), (0.30, 0.27, 0.22), (0.15, 1.1))
RUBBER = Finish(k.METAL, (0.035, 0.035, 0.037), (0.14, 0.13, 0.11), (0.2, 9.0))
ROOF_FLAT = Finish(k.SOIL, (0.25, 0.25, 0.24), (0.36, 0.35, 0.33), (0.12,))

PLASTERS: tuple[Color, ...] = (
    (0.62, 0.56, 0.44), (0.58, 0.42, 0.28), (0.66, 0.64, 0.58), (0.48, 0.50, 0.46), (0.60, 0.48, 0.40),
    (0.42, 0.48, 0.52), (0.66, 0.58, 0.36), (0.50, 0.34, 0.26), (0.56, 0.60, 0.52),
)  # fmt: skip
BRICKS: tuple[Color, ...] = ((0.34, 0.14, 0.09), (0.40, 0.20, 0.13), (0.28, 0.13, 0.10), (0.42, 0.30, 0.20))
ASHLARS: tuple[Color, ...] = ((0.50, 0.45, 0.36), (0.40, 0.38, 0.35), (0.56, 0.50, 0.42))
ROOFS: tuple[Color, ...] = ((0.36, 0.15, 0.09), (0.26, 0.12, 0.09), (0.14, 0.15, 0.17), (0.30, 0.18, 0.12))
WOODWORK: tuple[Color, ...] = (
    (0.10, 0.20, 0.14), (0.16, 0.22, 0.34), (0.32, 0.17, 0.08),
    (0.36, 0.07, 0.05), (0.55, 0.53, 0.48), (0.08, 0.08, 0.09),
)  # fmt: skip
CARS: tuple[Color, ...] = (
    (0.55, 0.55, 0.54), (0.06, 0.06, 0.07), (0.32, 0.05, 0.05), (0.07, 0.12, 0.30),
    (0.28, 0.29, 0.31), (0.62, 0.60, 0.55), (0.10, 0.20, 0.14),
)  # fmt: skip
AUTUMN: tuple[Color, ...] = ((0.42, 0.26, 0.05), (0.36, 0.14, 0.04), (0.26, 0.17, 0.07), (0.20, 0.19, 0.05))
SIGNS: tuple[tuple[Color, Color], ...] = (
    ((0.08, 0.15, 0.40), (0.75, 0.74, 0.70)), ((0.60, 0.08, 0.05), (0.80, 0.78, 0.70)),
    ((0.70, 0.68, 0.60), (0.08, 0.07, 0.07)), ((0.07, 0.28, 0.14), (0.78, 0.76, 0.60)),
    ((0.75, 0.55, 0.10), (0.10, 0.06, 0.04)), ((0.06, 0.06, 0.06), (0.75, 0.65, 0.35)),
)  # fmt: skip


def pick(rng: np.random.Generator, options: tuple[Color, ...]) -> Color:
    """Return one of the colours, a little lighter or darker."""
    return darker(options[int(rng.integers(len(options)))], 1.0 + 0.12 * (2.0 * rng.random() - 1.0))


def darker(color: Color, factor: float) -> Color:
    """Return the colour times a factor."""
    return (color[0] * factor, color[1] * factor, color[2] * factor)


def wall(rng: np.random.Generator) -> Finish:
    """Return plaster, brick or ashlar."""
    kind = rng.random()
    if kind < 0.5:
        color = pick(rng, PLASTERS)
        return Finish(k.PLASTER, color, darker(color, 0.45), (0.13 + 0.06 * rng.random(),))
    if kind < 0.8:
        return Finish(k.BRICK, pick(rng, BRICKS), (0.46, 0.42, 0.36), (0.15, 0.23, 0.075, 0.012, 0.5))
    color = pick(rng, ASHLARS)
    return Finish(k.STONE, color, darker(color, 0.5), (0.15, 0.55 + 0.5 * rng.random(), 0.32, 0.012, 0.5))


def window(width: float, height: float, frame: Color, rng: np.random.Generator, across: int = 2, up: int = 2) -> Finish:
    """Return a window of dark glass with mirrored shapes, some curtains, and a frame."""
    glass = (0.045 + 0.04 * rng.random(), 0.055 + 0.04 * rng.random(), 0.065 + 0.04 * rng.random())
    curtain = float(rng.random() < 0.55) * (0.4 + 0.6 * rng.random())
    return Finish(k.WINDOW, glass, frame, (0.45, width, height, across, up, curtain))


def sign(width: float, height: float, rng: np.random.Generator, lines: int = 1) -> Finish:
    """Return a board with rows of glyphs."""
    board, ink = SIGNS[int(rng.integers(len(SIGNS)))]
    return Finish(k.SIGN, board, ink, (0.11, width, height, height / (4.0 + 9.0 * lines)))


def painted_metal(color: Color, seam: float = 50.0) -> Finish:
    """Return painted sheet metal with a panel line every `seam` metres."""
    return Finish(k.METAL, color, (0.24, 0.21, 0.17), (0.11, seam))


def slats(color: Color, height: float = 0.09) -> Finish:
    """Return boards one above the other."""
    return Finish(k.SLATS, color, params=(0.14, height))


def foliage(rng: np.random.Generator) -> Finish:
    """Return leaves, dark in the depth and bright at the tips."""
    green = (0.05 + 0.03 * rng.random(), 0.10 + 0.04 * rng.random(), 0.03 + 0.01 * rng.random())
    return Finish(k.FOLIAGE, green, (green[0] * 3.2, green[1] * 2.6, green[2] * 2.4), (0.34,))


def autumn_leaves(rng: np.random.Generator) -> Finish:
    """Return leaves that fall soon."""
    tips = pick(rng, AUTUMN)
    return Finish(k.FOLIAGE, darker(tips, 0.4), tips, (0.34,))
