"""The networks of the missions: five drives through the simulated city, and its places."""

from __future__ import annotations

import numpy as np

from cycab_sim.world.paths import Path as Way
from cycab_sim.world.paths import Piece, turn
from path_follower.routes.building import TaughtDrive, even_curve
from path_follower.routes.network import Network, Spot

CRUISE = 2.0  # m/s
RIGHT = 1.75  # m to the right of the middle of a street
SOUTH, NORTH = -RIGHT, 110.0 + RIGHT  # y of the streets A eastwards and B westwards
CORNERS = (  # of the drives, driven in this order; the first is where one begins
    ((0.0, SOUTH), (120.0, SOUTH), (120.0, NORTH), (-20.0 - RIGHT, NORTH), (-20.0 - RIGHT, SOUTH), (30.0, SOUTH)),
    ((0.0, SOUTH), (40.0 + RIGHT, SOUTH), (40.0 + RIGHT, NORTH), (0.0, NORTH)),
    ((90.0, NORTH), (40.0 - RIGHT, NORTH), (40.0 - RIGHT, SOUTH), (80.0, SOUTH)),
    ((60.0, SOUTH), (95.0, SOUTH), (95.0, NORTH), (55.0, NORTH)),
    ((-20.0 + RIGHT, -50.0), (-20.0 + RIGHT, 110.0 - RIGHT), (40.0 - RIGHT, 110.0 - RIGHT), (40.0 - RIGHT, 30.0)),
)
PLACES = {"square": (100.0, SOUTH), "lane": (120.0, 60.0), "market": (80.0, NORTH)}
PLACES |= {"church": (-20.0 - RIGHT, 60.0), "gate": (40.0 + RIGHT, 60.0), "school": (40.0 - RIGHT, 60.0)}


def taught_drives(rng: np.random.Generator) -> list[TaughtDrive]:
    """Return the drives as they were recorded: a few centimetres beside what was meant, slowly varying."""
    drives = []
    for corners in CORNERS:
        way = rounded_way(corners)
        x, y, yaw, _ = way.at(np.arange(0.0, way.length, 0.1)).T
        s = 0.1 * np.arange(len(x))
        off = sum(
            0.03 * np.sin(2 * np.pi * s / wave + phase)
            for wave, phase in zip((23.0, 41.0), rng.uniform(0, 6.28, 2), strict=True)
        )
        drives.append(
            TaughtDrive(even_curve(x - off * np.sin(yaw), y + off * np.cos(yaw), yaw, np.full(len(x), CRUISE)))
        )
    return drives


def rounded_way(corners: tuple[tuple[float, float], ...]) -> Way:
    """Return the way along an open polygon whose inner corners are arcs of 6 m radius."""
    points = np.array(corners)
    legs = np.diff(points, axis=0)
    lengths, heads = np.hypot(*legs.T), np.arctan2(legs[:, 1], legs[:, 0])
    turns = (np.diff(heads) + np.pi) % (2 * np.pi) - np.pi
    cuts = np.concatenate([[0.0], 6.0 * np.tan(np.abs(turns) / 2), [0.0]])
    pieces: list[Piece] = []
    for number, length in enumerate(lengths):
        pieces.append(Piece(float(length - cuts[number] - cuts[number + 1])))
        if number < len(turns):
            pieces.append(turn(6.0, float(np.degrees(turns[number]))))
    return Way((*corners[0], float(heads[0])), tuple(pieces))


def named(network: Network) -> Network:
    """Return a network with those of the places that are on it."""
    for name, at in PLACES.items():
        spots = []
        for edge in network.edges.values():
            off = np.hypot(edge.curve.x - at[0], edge.curve.y - at[1])
            spots.append(Spot(edge.id, float(edge.curve.arc[int(np.argmin(off))]), float(off.min())))
        nearest = min(spots, key=lambda spot: spot.left)
        network = network.with_place(name, nearest) if nearest.left < RIGHT else network
    return network
