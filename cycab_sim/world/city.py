"""A city of 305 x 230 m: wide streets, an open square of 100 x 100 m, a lane of 3 m, and a tour of 490 m through them.

The plan is always the same, the houses and all that stands in the streets are drawn from a seed. Names of streets:
A along y = 0 to the square's west side, D from its east side on, B along y = 110, C along x = -20, F along x = 40,
S along x = 150 to the square's south side; the lane leads from the square's north side to B along x = 120.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from cycab_sim.params import SeasonParams
from cycab_sim.world import finishes, furniture
from cycab_sim.world.mesh import Finish, Mesh, MeshBuilder, Rectangle, flat
from cycab_sim.world.paths import Path, Piece, rounded, turn
from cycab_sim.world.street import KERB_HEIGHT, add_ground, add_pavement, add_street
from cycab_sim.world.texture import kernels as k
from cycab_sim.world.town import add_houses, add_row, add_skyline, furnish, street_ends

BOUNDS: Rectangle = (-75.0, -80.0, 230.0, 150.0)
SQUARE: Rectangle = (70.0, -45.0, 170.0, 55.0)
HALF = 5.5  # kerb to the middle of a street, m
LANE_X = 120.0  # of the lane, which is 3 m wide
TOUR_LENGTH = 490.0  # the long drive of M15 section 6.4.4
BLOCKS: tuple[tuple[Rectangle, str], ...] = (
    # with their sides: see town.STREETS
    ((-14.5, 5.5, 34.5, 104.5), "ssss"),
    ((45.5, 5.5, 70.0, 55.0), "saqs"),
    ((45.5, 55.0, 118.5, 104.5), "qsls"),
    ((121.5, 55.0, 230.0, 104.5), "qssl"),
    ((170.0, 5.5, 230.0, 55.0), "sasq"),
    ((170.0, -45.0, 230.0, -5.5), "assq"),
    ((155.5, -80.0, 230.0, -45.0), "sqss"),
    ((70.0, -80.0, 144.5, -45.0), "sqsa"),
    ((-14.5, -80.0, 70.0, -5.5), "ssqs"),
    ((-75.0, 5.5, -25.5, 104.5), "ssss"),
    ((-75.0, -80.0, -25.5, -5.5), "ssss"),
    ((-75.0, 115.5, -25.5, 150.0), "ssss"),
    ((-14.5, 115.5, 230.0, 150.0), "ssss"),
)
TRAM = ((151.75, -83.4), (151.75, -1.75), (233.4, -1.75), (233.4, -83.4))
TRAM_RADIUS, GAUGE = 8.0, 1.435
FLAGS = Finish(k.PAVING, (0.40, 0.37, 0.33), (0.20, 0.19, 0.17), (0.15, 0.9, 0.6, 0.014, 0.5))
BAND = Finish(k.PAVING, (0.22, 0.21, 0.20), (0.12, 0.11, 0.11), (0.15, 0.45, 0.3, 0.014, 0.5))


def tour() -> Path:
    """Return the path: along A, over the square, through the lane, back along B and down C."""
    pieces = (Piece(142.0), turn(8.0, 90), Piece(99.5), turn(6.0, 90), Piece(129.75), turn(6.0, 90))
    return Path((-30.0, -1.75, 0.0), (*pieces, Piece(TOUR_LENGTH - sum(piece.length for piece in pieces))))


@lru_cache(maxsize=1)
def build_city(seed: int, season: SeasonParams) -> Mesh:
    """Return the city of a seed."""
    mesh = MeshBuilder(np.random.default_rng([seed, 63]), season)
    add_ground(mesh, BOUNDS)
    for block, sides in BLOCKS:
        add_pavement(mesh, block)
        add_houses(mesh, block, sides)
        furnish(mesh, block, sides)
    x0, y0, x1, y1 = BOUNDS
    east, north = SQUARE[2], np.pi / 2
    for place, length, crossings in (
        ((x0, 0.0), SQUARE[0] - x0, (-20.0 - x0, 40.0 - x0)),
        ((east, 0.0), x1 - east, ()),
        ((x0, 110.0), x1 - x0, (-20.0 - x0, 40.0 - x0)),
        ((-20.0, y0, north), y1 - y0, (-y0, 110.0 - y0)),
        ((40.0, HALF, north), 110.0 - 2 * HALF, ()),
        ((150.0, y0, north), SQUARE[1] - y0, ()),
    ):
        add_street(mesh.at(*place), length, crossings, HALF)
    _add_square(mesh)
    _add_rails(mesh)
    _close_views(mesh)
    add_skyline(mesh, BOUNDS)
    return mesh.build()


def _add_square(mesh: MeshBuilder) -> None:
    """Add the flags of the square, and what stands around and upon it."""
    rng = mesh.rng
    x0, y0, x1, y1 = SQUARE
    mesh.panels(flat(x0, y0, x1, y1, 0.008), FLAGS)
    for y in np.arange(y0 + 10.0, y1 - 5.0, 10.0):
        mesh.panels(flat(x0 + 8, y, x1 - 8, y + 0.6, 0.011), BAND)
    for x in np.arange(x0 + 7.0, x1 - 5.0, 9.0):
        for y in (y0 + 5.0, y1 - 5.0):
            if abs(x - LANE_X) > 5.0 and not (y < 0.0 and abs(x - TRAM[0][0]) < 6.0):
                furniture.add_tree(mesh.at(x, y, rng.uniform(0, 6.28)))
                furniture.add_bench(mesh.at(x + 4.5, y, np.pi / 2 if y < 0 else -np.pi / 2))
    for y in np.arange(y0 + 12.0, y1 - 10.0, 9.0):
        for x in (x0 + 5.0, x1 - 5.0):
            if abs(y) > 9.0:
                furniture.add_tree(mesh.at(x, y, rng.uniform(0, 6.28)))
    for x, y in ((90.0, 8.0), (90.0, -8.0), (112.0, -14.0), (135.0, 8.0), (128.0, 30.0), (110.0, 46.0), (160.0, 6.0)):
        furniture.add_lamp(mesh.at(x, y, rng.uniform(0, 6.28)))
    furniture.add_monument(mesh.at(98.0, 27.0, 0.6))
    furniture.add_kiosk(mesh.at(100.0, -26.0, 0.2))
    for x, y, length, yaw in ((138.0, 20.0, 16.0, 0.0), (138.0, 32.0, 16.0, 0.0), (84.0, -20.0, 10.0, np.pi / 2)):
        furniture.add_hedge(mesh.at(x, y, yaw), length)
    for _ in range(8):
        x, y = rng.uniform(84.0, 96.0), rng.uniform(-36.0, -32.0)
        furniture.add_box(mesh.clutter().at(x, y, rng.uniform(0, 6.28)))


def _add_rails(mesh: MeshBuilder) -> None:
    """Add the two rails of the tram where they can be seen."""
    path = rounded(np.array(TRAM), TRAM_RADIUS)
    s = np.arange(0.0, 160.0, 1.0)
    poses = path.at(s)
    left = np.stack([-np.sin(poses[:, 2]), np.cos(poses[:, 2]), 0.0 * s], axis=1)
    middle = np.stack([poses[:, 0], poses[:, 1], np.full(len(s), 0.014)], axis=1)
    for off in (-GAUGE / 2, GAUGE / 2):
        a, b = middle + (off - 0.035) * left, middle + (off + 0.035) * left
        mesh.panels(np.stack([a[:-1], a[1:], b[1:], b[:-1]], axis=1), finishes.METAL)


def _close_views(mesh: MeshBuilder) -> None:
    """Close the ends of the streets by houses across."""
    for end in street_ends(mesh, BOUNDS, 10.0, (0.0, 110.0), (-20.0,), (-20.0, 150.0)):
        add_row(end.at(-16.0, 0.0, 0.0, -KERB_HEIGHT), 32.0, 9.0)
