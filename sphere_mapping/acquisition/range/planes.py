"""Range of bare regions whose outline is measured and lies on one plane: not measured itself, and marked so.

A wall without texture has no match of its own, but its edges have: pieces of the outline of a bare region are matched
along the columns by all their pixels, those where the outline runs across the columns (along them it tells nothing of
range, and what is beside it would speak instead). A plane is fitted to them, 1 / range = n . ray, by the deviations of
the pieces. It is taken if they agree with one plane (of true ones 0.3 % are refused for each piece, up to 50 pieces,
and one in a thousand by the sum of all squares), and if none of them alone decides it. So a bare box before a wall has
the range of the box, whose upper and lower edges say so, and what is bounded by several things at several ranges, as
the sky, has none. What cannot be told are bare things that bulge between edges which do not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.stats import chi2

from sphere_mapping.acquisition.constants import (
    AGREEMENT_SIGMAS,
    AROUND_PX,
    CELL_PX,
    FALSE_ALARM,
    FAR_M,
    HALF_PIECE_PX,
    LEAST_NOISE,
    MAX_DENIED,
    MAX_ELEVATION,
    MAX_LEFT,
    MAX_LEVERAGE,
    MAX_OFF_SHARE,
    MAX_PIECE_STD_PX,
    MAX_RELATIVE_STD,
    MIN_ACROSS,
    MIN_CLEAR,
    MIN_EDGE_PIXELS,
    MIN_PIECE_STD_PX,
    MIN_PIECES,
    MIN_RANGE_SHARE,
    MIN_REGION_PX,
    MIN_UNKNOWN,
    OUTLINE_BLUR_PX,
    OUTLINE_EDGE,
    PIECES_APART_PX,
    PLANES_WIDTH,
    RELATIVE_STD,
)
from sphere_mapping.acquisition.kernels import match_outline
from sphere_mapping.acquisition.params import MatchParams
from sphere_mapping.acquisition.range.fusion import Ranged
from sphere_mapping.acquisition.range.levels import halve_image, usable_at
from sphere_mapping.acquisition.range.matching import Search
from sphere_nav.geometry import Spherical
from sphere_nav.geometry.arrays import Array


@dataclass(frozen=True, eq=False)
class Outline:
    """Pieces of the outline of a region: its number, corners (n, 2: row, column) and masks (n, S, S)."""

    region: int
    corners: NDArray[np.int64]
    masks: Flags


def bare_regions(
    top: Image, range_m: Plane, is_usable: Flags, level: int
) -> tuple[NDArray[np.int32], NDArray[np.int32], int]:
    """Return labels (h, w) of bare regions, their boxes (n, 6: number, column, row, width, height, area), and a seam.

    The labels are rolled so that the column with the fewest bare pixels, the seam, is the first.
    """
    shape, step = top.shape, 2**level
    is_bare = (_slope(top) < OUTLINE_EDGE) & usable_at(is_usable, level, shape)
    opened = cv2.morphologyEx(is_bare.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    seam = int(np.argmin(opened.sum(axis=0)))
    number, labels, boxes, _ = cv2.connectedComponentsWithStats(np.roll(opened, -seam, axis=1), connectivity=4)
    is_unknown = np.roll(np.isnan(range_m[::step, ::step][: shape[0], : shape[1]]), -seam, axis=1)
    unknown = np.bincount(labels[is_unknown], minlength=number)
    keep = (boxes[:, 4] >= MIN_REGION_PX) & (unknown >= MIN_UNKNOWN * boxes[:, 4])
    keep[0] = False
    return labels, np.column_stack([np.flatnonzero(keep), boxes[keep]]).astype(np.int32), seam


def _slope(image: Image) -> Plane:
    """Return the slope (h, w) of a blurred whole sphere, grey levels per px."""
    margin = int(4 * OUTLINE_BLUR_PX) + 2
    wide = cv2.copyMakeBorder(image, 0, 0, margin, margin, cv2.BORDER_WRAP).astype(np.float32)
    smooth = cv2.GaussianBlur(wide, (0, 0), OUTLINE_BLUR_PX)
    across, along = (cv2.Sobel(smooth, cv2.CV_32F, *axes, ksize=1, scale=0.5) for axes in ((1, 0), (0, 1)))
    return np.asarray(np.hypot(across, along)[:, margin:-margin], dtype=np.float32)


def cut_outlines(top: Image, labels: NDArray[np.int32], boxes: NDArray[np.int32]) -> Iterator[Outline]:
    """Yield the outline of each region, of an image and labels (h, w) and boxes as `bare_regions` has them."""
    is_edge = _slope(top) >= OUTLINE_EDGE
    height, width = labels.shape
    margin, side = AROUND_PX + HALF_PIECE_PX + CELL_PX, 2 * HALF_PIECE_PX + 1
    for number, column, row, box_width, box_height, _ in boxes:
        rows = slice(max(row - margin, 0), min(row + box_height + margin, height))
        columns = slice(max(column - margin, 0), min(column + box_width + margin, width))
        inside = (labels[rows, columns] == number).astype(np.uint8)
        near = cv2.dilate(inside, np.ones((2 * AROUND_PX + 1,) * 2, np.uint8)) > 0
        v, u = np.nonzero(near & is_edge[rows, columns])
        if v.size == 0:
            continue
        middle = _middles(v, u, cv2.GaussianBlur(inside.astype(np.float32), (0, 0), AROUND_PX / 2))
        corner = middle - HALF_PIECE_PX
        fits = np.all((corner >= 0) & (corner + side <= np.array(near.shape)), axis=1)
        corner = corner[fits]
        masks = sliding_window_view(near, (side, side))[corner[:, 0], corner[:, 1]]
        if len(corner):
            yield Outline(int(number), corner + np.array([rows.start, columns.start]), masks)


def _middles(v: NDArray[np.intp], u: NDArray[np.intp], inside: Plane) -> NDArray[np.int64]:
    """Return the middles (n, 2) of the squares of an outline's pixels in which it runs across the columns."""
    keys = (v // CELL_PX) * (inside.shape[1] // CELL_PX + 1) + u // CELL_PX
    _, piece = np.unique(keys, return_inverse=True)
    along, across = (np.gradient(inside, axis=axis)[v, u] for axis in (0, 1))
    count, sum_v, sum_u, along, across = (
        np.bincount(piece, weights) for weights in (None, v, u, along.astype(float), across.astype(float))
    )
    keep = (count >= MIN_EDGE_PIXELS) & (np.abs(along) >= MIN_ACROSS * np.hypot(along, across))
    order = np.flatnonzero(keep)[np.argsort(-count[keep], kind="stable")]
    middles = np.stack([sum_v[order] / count[order], sum_u[order] / count[order]], axis=1)
    is_apart = np.ones(len(middles), np.bool_)
    for k in range(1, len(middles)):  # pieces that overlap would count twice
        is_apart[k] = np.all(np.abs(middles[:k][is_apart[:k]] - middles[k]).max(axis=1) >= PIECES_APART_PX)
    return middles[is_apart].astype(np.int64)


Plane = NDArray[np.float32]
Flags = NDArray[np.bool_]
Image = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Viewpoints:
    """From where the pixels of the upper sphere are seen.

    owner (H, W): number of the camera of each pixel; centres (N, 3) m of the cameras in the frame of the sphere;
    baseline_error (H, W), shrink (H, W), per_m: of `epipolar.correct_baseline`. A point at range r from the camera at o
    is o (1 - r per_m) + r (1 + o . ray per_m) ray.
    """

    baseline_m: float
    owner: NDArray[np.int8]
    centers: Plane
    baseline_error: Plane
    shrink: Plane
    per_m: float


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Pieces of all outlines: region (N,), directions (N, 3) and places (N, 3), inverse ranges and deviations (N,)."""

    region: NDArray[np.int64]
    rays: Array
    centers: Array
    inverse: Array
    std: Array


def range_of_planes(
    top: Image,
    bottom: Image,
    ranged: Ranged,
    is_usable: Flags,
    viewpoints: Viewpoints,
    search: Search,
    params: MatchParams,
) -> Ranged:
    """Return range and deviation (H, W) in m of bare regions of a whole upper sphere where they are not measured.

    NaN elsewhere. What is measured and contradicts the plane counts for nothing: blocks at the rim of a bare region see
    the edge of another thing. top, bottom: as for `match_columns`, whole spheres; ranged: what is measured, from the
    viewpoints.
    """
    whole = Spherical(top.shape[1], top.shape[0])
    found = np.full(top.shape, np.nan, np.float32), np.full(top.shape, np.nan, np.float32)
    level = max(int(np.ceil(np.log2(whole.width / PLANES_WIDTH))), 0)
    for _ in range(level):
        top, bottom = halve_image(top, is_whole=True), halve_image(bottom, is_whole=True)
    labels, boxes, seam = bare_regions(top, ranged[0], is_usable, level)
    if len(boxes) == 0:
        return found
    rolled = [np.roll(image, -seam, axis=1) for image in (top, bottom)]
    outlines = list(cut_outlines(rolled[0], labels, boxes))
    if not outlines:
        return found
    pieces = _match(rolled, outlines, seam, level, whole, viewpoints, search, params)
    planes = {}
    for region in np.unique(pieces.region):
        own = pieces.region == region
        plane = _fit(pieces.rays[own], pieces.centers[own], pieces.inverse[own], pieces.std[own], viewpoints.per_m)
        if plane is not None:
            planes[int(region)] = plane
    if planes:
        _extend(planes, np.roll(labels, seam, axis=1), level, viewpoints, ranged, params, found)
    return found


def _match(
    images: list[Image],
    outlines: Sequence[Outline],
    seam: int,
    level: int,
    whole: Spherical,
    viewpoints: Viewpoints,
    search: Search,
    params: MatchParams,
) -> _Pieces:
    """Return the pieces that have a clear match, with their inverse ranges."""
    step = 2**level
    region = np.concatenate([np.full(len(outline.corners), outline.region) for outline in outlines])
    corner = np.concatenate([outline.corners for outline in outlines])
    masks = np.ascontiguousarray(np.concatenate([outline.masks for outline in outlines]))
    first = int(np.floor(search.first_px / step)) - 1
    costs, found = np.empty(int(search.last_px / step) + 3 - first), np.empty((len(corner), 7))
    top, bottom = (image.astype(np.float32) for image in images)
    match_outline(top, bottom, corner.astype(np.int32), masks, first, costs, found)
    noise = max(params.noise / step, min(params.noise, LEAST_NOISE))
    disparity, least, elsewhere, number, squares, contrast, rows = found.T
    with np.errstate(invalid="ignore", divide="ignore"):
        floor = number * 2 * noise**2
        variance = 2 * noise**2 / squares
        above = (rows * step + 0.5) * np.pi / whole.height
        is_clear = (elsewhere + floor >= MIN_CLEAR * (least + floor)) & (variance <= MAX_PIECE_STD_PX**2)
        is_clear &= (least <= MAX_LEFT[0] * floor + MAX_LEFT[1] * contrast) & (disparity > 0)
        is_clear &= np.abs(above - np.pi / 2) <= MAX_ELEVATION
    disparity, least, floor, variance, above, rows = (
        values[is_clear] for values in (disparity, least, floor, variance, above, rows)
    )
    column = (corner[is_clear, 1] + HALF_PIECE_PX + seam) * step % whole.width
    row = np.clip(np.rint(rows * step), 0, whole.height - 1).astype(np.int64)
    std = np.sqrt(variance * np.maximum(least / floor, 1.0) + MIN_PIECE_STD_PX**2)
    inverse, inverse_std = _inverse_range(disparity * step, std * step, above, viewpoints.baseline_m, whole)
    error = viewpoints.baseline_error[row, column].astype(np.float64)
    shrink = viewpoints.shrink[row, column].astype(np.float64)
    factor = (1.0 + error * viewpoints.per_m / inverse) / (1.0 + error) / shrink
    rays = whole.unproject(np.stack([column, rows * step], axis=1).astype(np.float64))
    centers = viewpoints.centers[viewpoints.owner[row, column]].astype(np.float64)
    return _Pieces(region[is_clear], rays, centers, inverse * factor, inverse_std * np.abs(factor))


def _inverse_range(
    disparity: Array, std: Array, above: Array, baseline_m: float, whole: Spherical
) -> tuple[Array, Array]:
    """Return 1 / range from the upper centre and its deviation, 1/m, of disparities in px at colatitudes `above`."""
    per_row = np.pi / whole.height
    delta = disparity * per_row
    inverse = 1.0 / (baseline_m * (np.sin(above) / np.tan(delta) - np.cos(above)))
    slope = baseline_m * np.sin(above) / np.sin(delta) ** 2 * inverse**2
    return inverse, slope * std * per_row


def _fit(rays: Array, centers: Array, inverse: Array, std: Array, per_m: float) -> tuple[Array, Array] | None:
    """Return the plane n (3,), n . point = 1, and its covariance; None where the pieces are not on one plane.

    With the points of `Viewpoints` n . ((1 + centre . ray per_m) ray + centre (1 / r - per_m)) = 1 / r.
    """
    if len(rays) < MIN_PIECES:
        return None
    longer = 1.0 + per_m * np.sum(rays * centers, axis=1)
    rows = (longer[:, None] * rays + centers * (inverse - per_m)[:, None]) / std[:, None]
    is_on = np.ones(len(rays), np.bool_)
    for _ in range(3):
        squares = rows[is_on].T @ rows[is_on]
        if is_on.sum() < MIN_PIECES or np.linalg.cond(squares) > 1e12:
            return None
        covariance = np.asarray(np.linalg.inv(squares), dtype=np.float64)
        n = covariance @ (rows[is_on].T @ (inverse / std)[is_on])
        off = inverse / std - rows @ n
        is_on = np.abs(off) < AGREEMENT_SIGMAS
    freedom = int(is_on.sum()) - 3
    if np.einsum("ij,jk,ik->i", rows[is_on], covariance, rows[is_on]).max() > MAX_LEVERAGE:
        return None
    if np.mean(~is_on) > MAX_OFF_SHARE or np.sum(off[is_on] ** 2) > chi2.ppf(1 - FALSE_ALARM, freedom):
        return None
    return n, covariance * max(float(np.sum(off[is_on] ** 2)) / freedom, 1.0)


def _extend(
    planes: Mapping[int, tuple[Array, Array]],
    labels: NDArray[np.int32],
    level: int,
    viewpoints: Viewpoints,
    ranged: Ranged,
    params: MatchParams,
    found: Ranged,
) -> None:
    """Write the range of the planes of regions (labels (h, w)), and its deviation, where nothing else is measured."""
    step, whole = 2**level, Spherical(found[0].shape[1], found[0].shape[0])
    number = np.full(int(labels.max()) + 1, -1)
    number[list(planes)] = np.arange(len(planes))
    wide = np.repeat(np.repeat(number[labels].astype(np.int16), step, axis=0), step, axis=1)
    wide = np.roll(wide, (-(step // 2), -(step // 2)), axis=(0, 1))  # pixel k of the small image is pixel step k
    v, u = np.nonzero(wide >= 0)
    own = wide[v, u]
    n, covariance = (np.stack([plane[k] for plane in planes.values()])[own] for k in (0, 1))
    rays = whole.unproject(np.stack([u, v], axis=1).astype(np.float64))
    centers = viewpoints.centers[viewpoints.owner[v, u]]
    along, offset = np.sum(centers * rays, axis=1), np.sum(centers * n, axis=1)
    inverse = ((1.0 + viewpoints.per_m * along) * np.sum(rays * n, axis=1) - viewpoints.per_m * offset) / (1.0 - offset)
    variance = np.einsum("ij,ijk,ik->i", rays, covariance, rays) + (RELATIVE_STD * inverse) ** 2
    keep = (inverse > 1.0 / FAR_M) & (inverse < 1.0 / (MIN_RANGE_SHARE * params.nearest_m))
    keep &= variance < (MAX_RELATIVE_STD * inverse) ** 2
    v, u, own, range_m, std_m = (
        v[keep],
        u[keep],
        own[keep],
        1 / inverse[keep],
        np.sqrt(variance[keep]) / inverse[keep] ** 2,
    )
    measured, measured_std = (plane[v, u] for plane in ranged)
    off = np.abs(measured - range_m)  # NaN, and so not denied, where nothing is measured
    is_denied = off > AGREEMENT_SIGMAS * np.hypot(measured_std, std_m)
    shares = [np.bincount(own[which], minlength=len(planes)) for which in (is_denied, ~np.isnan(measured))]
    keep = (np.isnan(measured) | is_denied) & (shares[0] <= MAX_DENIED * shares[1])[own]
    found[0][v[keep], u[keep]], found[1][v[keep], u[keep]] = range_m[keep], std_m[keep]
