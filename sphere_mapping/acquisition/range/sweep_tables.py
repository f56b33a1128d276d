"""What the sweep on the sphere knows of a rig before any image: where each camera of whatever model has a direction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.constants import (
    ERODED_PX,
    FAINT_STRETCH,
    GRID_STEP,
    HYPOTHESIS_PX,
    MAX_VIEWS,
    MIN_BASELINE_M,
    MIN_SHARED_VIEW,
    SIGHT_M,
    VERY_FAR_M,
    VIEW_GRID,
)
from sphere_mapping.acquisition.range.kernels import NUM_HYPOTHESES
from sphere_mapping.acquisition.stitching.views import RigView, axes_of
from sphere_nav.geometry import Rig, RigCamera, Spherical
from sphere_nav.geometry.arrays import Array, Flags, Floats, Integers
from sphere_nav.geometry.cameras.camera import pixel_rays

Indices = NDArray[np.int32]
BEFORE = 1  # hypotheses beyond infinity
AFTER = 2  # nearest ones, which have no neighbors to be compared with


@dataclass(frozen=True, eq=False)
class SweepLevel:
    """A level of the sphere, and of the images that are sampled there, all cameras one after the other.

    directions: sine and cosine of azimuths (2, W) and elevations (2, H). halvings (C,): of each camera's images; starts
    (C,), sizes (C, 2): where they are in the buffer, rows and columns; is_dead (C, h, w): pixels without use.
    """

    whole: Spherical
    directions: tuple[Floats, Floats]
    halvings: tuple[int, ...]
    starts: Integers
    sizes: Integers
    scales: Floats
    is_dead: tuple[Flags, ...]


@dataclass(frozen=True, eq=False)
class CameraSight:
    """Which cameras see a direction of the coarsest level: indices (H, W, N) i8, the least stretched first; how many.

    runs, first_runs: for each level, the finest first, which columns of a row a camera sees (`kernels.align`).
    """

    cameras: NDArray[np.int8]
    numbers: NDArray[np.int8]
    runs: tuple[Indices, ...]
    first_runs: tuple[Indices, ...]


def level_of(whole: Spherical, views: Sequence[RigView]) -> SweepLevel:
    """Return a level whose images are about as fine as the sphere is."""
    halvings, is_dead = [], []
    for view in views:
        finer = view.camera.pixels_per_radian / whole.pixels_per_radian
        halvings.append(max(round(np.log2(finer)), 0))
        step = 2 ** halvings[-1]
        border_px = view.border[::step, ::step] * view.camera.pixels_per_radian / step
        is_dead.append(border_px <= ERODED_PX)
    sizes = np.array([dead.shape for dead in is_dead], np.int64)
    starts = np.concatenate([[0], np.cumsum(sizes.prod(axis=1))])
    azimuths, elevations = axes_of((whole.height, whole.width))
    scales = np.array([0.5**halved for halved in halvings], np.float32)
    return SweepLevel(whole, (azimuths, elevations), tuple(halvings), starts, sizes, scales, tuple(is_dead))


def hypotheses_of(views: Sequence[RigView], coarsest: Spherical, nearest_m: float) -> tuple[float, float]:
    """Return the first inverse range (1/m) that is looked for, and the step to the next one.

    They reach to the nearest range wanted, where neighbors among the cameras then see steps of about a pixel.
    """
    centers = [view.T_sphere_camera.translation for view in views]
    apart = [[float(np.linalg.norm(a - b)) for b in centers if np.linalg.norm(a - b) > 0] for a in centers]
    baseline_m = float(np.median([min(one, default=1.0) for one in apart]))
    least, most = (px / (baseline_m * coarsest.pixels_per_radian) for px in HYPOTHESIS_PX)
    step = min(max(1.0 / (nearest_m * (NUM_HYPOTHESES - BEFORE - AFTER)), least), most)
    return -BEFORE * step, step


def hypothesis_table(views: Sequence[RigView], level: SweepLevel, first: float, step: float) -> Floats:
    """Return the pixels (gh, C, gw, 2, K) of the cameras in every GRID_STEP-th direction at all hypotheses."""
    whole = level.whole
    rows, columns = (np.arange(0, side + GRID_STEP, GRID_STEP) for side in (whole.height, whole.width))
    rays = whole.unproject(np.stack(np.meshgrid(columns, rows), axis=-1).astype(np.float64))
    table = np.empty((rows.size, len(views), columns.size, 2, NUM_HYPOTHESES), np.float32)
    for c, view in enumerate(views):
        for k in range(NUM_HYPOTHESES):
            u, v, _ = view.look(_seen_from(view, rays, first + k * step))
            table[:, c, :, 0, k], table[:, c, :, 1, k] = u * level.scales[c], v * level.scales[c]
    return table


def sharpness(views: Sequence[RigView], whole: Spherical) -> Floats:
    """Return how much each camera stretches each direction (C, H, W), by its axis; Inf where it does not see it.

    Far from the axis of a wide lens a pixel covers another angle, so that what is fine there is coarse elsewhere and
    levels do not compare. The worst of very far and SIGHT_M counts.
    """
    rays = pixel_rays(whole)
    found = np.zeros((len(views), whole.height, whole.width), np.float32)
    for own, view in zip(found, views, strict=True):
        for inverse in (1.0 / VERY_FAR_M, 1.0 / SIGHT_M):
            points = _seen_from(view, rays, inverse)
            points /= np.linalg.norm(points, axis=-1, keepdims=True)
            J = view.camera.J_project(points)
            squares = J @ np.swapaxes(J, -1, -2)  # (H, W, 2, 2)
            mean = 0.5 * (squares[..., 0, 0] + squares[..., 1, 1])
            off = np.hypot(0.5 * (squares[..., 0, 0] - squares[..., 1, 1]), squares[..., 0, 1])
            stretch = np.sqrt(mean + off) / view.camera.pixels_per_radian
            is_seen = view.project(rays / inverse)[2] > 0
            own[...] = np.maximum(own, np.where(is_seen & np.isfinite(stretch), stretch, np.inf))
    return found


def sight_of(stretch: Floats, is_present: Flags, levels: Sequence[SweepLevel]) -> CameraSight:
    """Return which of the cameras present (C,) see what: those that stretch little, at least two where two see it."""
    stretch = np.where(is_present[:, None, None], stretch, np.float32(np.inf))
    order = np.argsort(stretch, axis=0, kind="stable")[:MAX_VIEWS]
    chosen = np.take_along_axis(stretch, order, axis=0)
    numbers = np.maximum((chosen <= FAINT_STRETCH).sum(axis=0), np.minimum(np.isfinite(chosen).sum(axis=0), 2))
    is_used = np.arange(len(order))[:, None, None] < numbers
    sees = np.stack([((order == c) & is_used).any(axis=0) for c in range(len(stretch))])
    scales = [1 << (len(levels) - 1 - k) for k in range(len(levels))]
    runs = [_runs(sees.repeat(scale, axis=1).repeat(scale, axis=2)) for scale in scales]
    cameras = np.ascontiguousarray(np.moveaxis(order, 0, -1)).astype(np.int8)
    return CameraSight(cameras, numbers.astype(np.int8), tuple(run[0] for run in runs), tuple(run[1] for run in runs))


def why_no_range(rig: Rig) -> str:
    """Return why no two cameras measure range: the pair that comes nearest, and what it lacks; empty: some do."""
    if len(rig.cameras) < 2:
        return f"rig {rig.name}: no range from stereo: expected two cameras, found {len(rig.cameras)}"
    least_m = MIN_BASELINE_M["side"]
    pairs = [
        (shared_view(a, b), float(np.linalg.norm(a.T_rig_camera.translation - b.T_rig_camera.translation)), a, b)
        for a, b in combinations(rig.cameras, 2)
    ]
    if any(share >= MIN_SHARED_VIEW and apart_m >= least_m for share, apart_m, *_ in pairs):
        return ""
    share, apart_m, a, b = max(pairs, key=lambda pair: pair[0])
    lack = f"centres {least_m} m apart, found {apart_m:.3f} m ({a.name}, {b.name})"
    if share < MIN_SHARED_VIEW:
        seen = f"{MIN_SHARED_VIEW:.0%} of the sphere seen by two cameras"
        lack = f"{seen}, found {share:.1%} at most ({a.name}, {b.name})"
    return f"rig {rig.name}: no range from stereo: expected {lack}"


def shared_view(a: RigCamera, b: RigCamera) -> float:
    """Return the share of all directions that both cameras see, masks or not."""
    rays = pixel_rays(VIEW_GRID)
    weight = np.hypot(rays[..., 0], rays[..., 1])  # columns are narrower towards the poles
    one, other = (part.camera.project(rays @ part.T_rig_camera.rotation)[1] for part in (a, b))
    return float(weight[one & other].sum() / weight.sum())


def _seen_from(view: RigView, rays: Array, inverse: float) -> Array:
    """Return points (..., 3) of a camera's frame, by their range, that the sphere has along rays."""
    T = view.T_sphere_camera
    return (rays - inverse * T.translation) @ T.rotation


def _runs(sees: Flags) -> tuple[Indices, Indices]:
    """Return runs (N, 3), row by row: camera, first column, beyond the last one, and the first (H + 1,) of each row.

    sees (C, H, W): which cameras see what.
    """
    edges = np.diff(np.pad(sees, ((0, 0), (0, 0), (1, 1))).astype(np.int8), axis=2)
    cameras, rows, begins = np.nonzero(edges == 1)
    ends = np.nonzero(edges == -1)[2]
    order = np.lexsort((begins, cameras, rows))
    runs = np.stack([cameras, begins, ends], axis=1)[order].astype(np.int32)
    return runs, np.searchsorted(rows[order], np.arange(sees.shape[1] + 1)).astype(np.int32)
