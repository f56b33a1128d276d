"""The gain of each exposure group and colour, so that cameras agree where they see the same."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from sphere_geometry import Spherical
from sphere_mapping.acquisition.views import Block, RigView, rays_of

Image = NDArray[np.uint8]

SHRINK = 4  # grey levels are compared in images this much smaller: parallax and noise matter less
GRID = 12  # px of the sphere between directions that are compared
FROM_BORDER = 0.03  # rad from the border of both cameras
DARKEST, BRIGHTEST = 10, 245  # grey levels between which exposures are compared
LIKE_ANGLE = 0.06  # rad by which the angles from both axes may differ: there the falloff of like lenses cancels
MAX_WHITE_BALANCE = 1.15  # largest factor of a colour over the mean of its camera's colours
MIN_SHARED = 50  # directions from which on two cameras are compared
STEADINESS = 1e-3  # weight of 'no change' against one comparison, so that lone cameras are determined


@dataclass(frozen=True, eq=False)
class Overlap:
    """Pixels (N,) of the shrunk images in which two cameras see the same directions."""

    first: str
    second: str
    rows: tuple[NDArray[np.intp], NDArray[np.intp]]
    columns: tuple[NDArray[np.intp], NDArray[np.intp]]


def overlaps_of(rig_views: Sequence[RigView], whole: Spherical, distance_m: float) -> list[Overlap]:
    """Return where pairs of cameras overlap; only where both look from like angles, if that is enough to compare.

    A lens darkens towards its rim. Where one camera sees by its middle what the other sees by its rim, the ratio of
    their levels is that of the lenses, not of the exposures.
    """
    rays = rays_of(whole, Block(0, 0, whole.height, whole.width), GRID) * (distance_m or 1e6)
    seen = {rig_view.name: rig_view.project(rays) for rig_view in rig_views}
    angles = {rig_view.name: _angles(rig_view, rays) for rig_view in rig_views}
    found = []
    for a, b in combinations(rig_views, 2):
        both = (seen[a.name][2] > FROM_BORDER) & (seen[b.name][2] > FROM_BORDER)
        if np.count_nonzero(both) < MIN_SHARED:
            continue
        alike = both & (np.abs(angles[a.name] - angles[b.name]) < LIKE_ANGLE)
        both = alike if np.count_nonzero(alike) >= MIN_SHARED else both
        places = [_places(rig_view, *seen[rig_view.name][:2], both) for rig_view in (a, b)]
        found.append(Overlap(a.name, b.name, (places[0][0], places[1][0]), (places[0][1], places[1][1])))
    return found


def gains_of(
    images: Mapping[str, Image], overlaps: Sequence[Overlap], groups: Mapping[str, str], max_gain: float
) -> dict[str, NDArray[np.float64]]:
    """Return the factor (channels,) of each camera; the geometric mean of all groups is 1.

    Cameras of one group share a factor; its colours differ by `MAX_WHITE_BALANCE` at most. The logarithms solve a
    least-squares problem with the median ratio of every overlapping pair of groups.
    """
    names = sorted({groups[name] for name in images})
    channels = 1 if next(iter(images.values())).ndim == 2 else 3
    ratios = []
    small = {name: _small(image) for name, image in images.items()} if overlaps else {}
    for pair in overlaps:
        if {pair.first, pair.second} <= set(images) and groups[pair.first] != groups[pair.second]:
            levels = (
                small[pair.first][pair.rows[0], pair.columns[0]],
                small[pair.second][pair.rows[1], pair.columns[1]],
            )
            if (ratio := log_ratio(*levels)) is not None:
                ratios.append((names.index(groups[pair.first]), names.index(groups[pair.second]), ratio))
    logs = log_gains(ratios, len(names), channels)
    grey = logs.mean(axis=1, keepdims=True)
    colour = np.clip(logs - grey, -np.log(MAX_WHITE_BALANCE), np.log(MAX_WHITE_BALANCE))
    factors = np.exp(np.clip(grey, -np.log(max_gain), np.log(max_gain)) + colour)
    return {name: factors[names.index(groups[name])] for name in images}


def apply_gain(image: Image, gain: NDArray[np.float64]) -> Image:
    """Return the image times its gain."""
    if np.all(np.abs(gain - 1.0) < 1e-3):
        return image
    levels = np.clip(np.rint(np.arange(256)[:, None] * gain), 0, 255).astype(np.uint8)
    return cv2.LUT(image, levels.reshape(1, 256, -1)).reshape(image.shape)


def log_gains(
    ratios: Sequence[tuple[int, int, NDArray[np.float64]]], number: int, channels: int
) -> NDArray[np.float64]:
    """Return the logarithms (number, channels), mean 0, of the factors that make what was compared agree best.

    ratios: numbers of two images and the logarithm (channels,) of the ratio of the first one's levels to the second's.
    """
    rows, values = [STEADINESS * np.eye(number)], [np.zeros((number, channels))]
    for first, second, ratio in ratios:
        row = np.zeros((1, number))
        row[0, first], row[0, second] = 1.0, -1.0
        rows.append(row)
        values.append(-ratio[None])
    logs = np.linalg.lstsq(np.vstack(rows), np.vstack(values), rcond=None)[0]
    return logs - logs.mean(axis=0)


def log_ratio(first: NDArray, second: NDArray) -> NDArray[np.float64] | None:
    """Return the logarithm (channels,) of the median ratio of levels (N, channels), None where too little compares."""
    fits = np.all((first > DARKEST) & (first < BRIGHTEST) & (second > DARKEST) & (second < BRIGHTEST), axis=1)
    if np.count_nonzero(fits) < MIN_SHARED:
        return None
    return np.median(np.log(first[fits] / second[fits]), axis=0)


def _angles(rig_view: RigView, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angle (...,) in radians between the optical axis and points (..., 3) of the sphere's frame."""
    seen = rig_view.T_sphere_camera.inverse().apply(points)
    return np.arctan2(np.linalg.norm(seen[..., :2], axis=-1), seen[..., 2])


def _small(image: Image) -> NDArray[np.float64]:
    size = (max(image.shape[1] // SHRINK, 1), max(image.shape[0] // SHRINK, 1))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.float64)
    return small if small.ndim == 3 else small[:, :, None]


def _places(
    rig_view: RigView, u: NDArray, v: NDArray, both: NDArray[np.bool_]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    sizes = max(rig_view.camera.height // SHRINK, 1), max(rig_view.camera.width // SHRINK, 1)
    row, column = ((plane[both] / SHRINK).astype(np.intp) for plane in (v, u))
    return np.clip(row, 0, sizes[0] - 1), np.clip(column, 0, sizes[1] - 1)
