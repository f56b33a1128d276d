"""Whether the images were good enough: what the residuals cannot show, told by name and with a number.

Blur, few views, boards that are all frontal, corners in one part of the image, and halves of the images that disagree
leave small residuals, and a lens that is wrong.

Where images that are taken for one instant were not taken at one, the rig cannot be rigid in the adjustment, and lenses
bear it: the joint adjustment does not say of every camera what its own images say. The test raises a false alarm once
in a thousand calibrations of a camera, by chi2: the joint estimate is the better one, so their difference varies less
than the single one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtrc

from rig_calibration.boards.bundle import AdjustmentProblem, RigState
from rig_calibration.boards.intrinsics import SingleCamera
from rig_calibration.boards.validation import Validation
from rig_calibration.boards.views import BoardView, Indices
from rig_calibration.constants import (
    MAX_BLUR_SHARE,
    MAX_HALVES_DEG,
    MAX_HALVES_FOCAL,
    MAX_HALVES_MM,
    MIN_COVERED,
    MIN_GOOD_VIEWS,
    MIN_TILT_DEG,
)
from sphere_nav.estimation.least_squares import RARE, squared_mahalanobis
from sphere_nav.geometry.arrays import Array, Flags
from sphere_nav.geometry.cameras.lens import lens_of
from sphere_nav.photometric.constants import CELLS

REMEDY = "were the images of each instant taken at one time, with board and rig at rest?"


def quality_warnings(
    names: Sequence[str],
    problem: AdjustmentProblem,
    state: RigState,
    kept: Array,
    views: Sequence[BoardView],
    validation: Validation,
) -> list[str]:
    """Return a line for every camera and what is wrong with its images; views as the problem has them."""
    lines: list[str] = []
    views_used = np.bincount(problem.seen.view, kept, minlength=problem.seen.num_views) > 0
    covered = covered_cells(problem, kept)
    for camera, name in enumerate(names):
        own = np.flatnonzero(views_used & (problem.seen.camera == camera))
        own_views, width = [views[int(k)] for k in own], problem.sizes[camera][0]
        count, tilt = len({view.instant for view in own_views}), tilt_deg(problem, state, own)
        blur, sharp = median_known([view.blur_px for view in own_views]), MAX_BLUR_SHARE * max(width, 1000)
        up_to, least = f"expected up to {sharp:.1f}", f"expected {MIN_TILT_DEG:.0f} or more"
        flaws = (
            (blur > sharp, f"blurred: edges of the boards have a standard deviation of {blur:.1f} px, {up_to}"),
            (count < MIN_GOOD_VIEWS, f"few views: {count} instants, expected {MIN_GOOD_VIEWS} or more"),
            (tilt < MIN_TILT_DEG, f"no tilt: boards differ by {tilt:.1f} deg in the mean, {least}"),
        )
        told = [line for is_wrong, line in flaws if is_wrong]
        lines += [f"{name}: {line}" for line in (*told, *_uncovered(covered[camera]), *_differs(validation, camera))]
    return lines


def median_known(values: Sequence[float]) -> float:
    """Return the median of what is known, NaN where nothing is."""
    return float(np.nanmedian(values)) if np.isfinite(values).any() else float("nan")


def covered_cells(problem: AdjustmentProblem, kept: Array) -> Flags:
    """Return whether a corner fell into each cell of every image (C, rows, columns)."""
    found = np.zeros((len(problem.models), CELLS[1], CELLS[0]), np.bool_)
    for camera, rows in problem.seen.camera_slices:
        (u, v), (width, height) = problem.seen.pixels[rows][kept[rows] > 0].T, problem.sizes[camera]
        found[camera] = np.histogram2d(v, u, CELLS[::-1], ((0, height), (0, width)))[0] > 0
    return found


def tilt_deg(problem: AdjustmentProblem, state: RigState, own: Indices) -> float:
    """Return by how much boards of some views are tilted against one another: RMS angle of normals, in degrees.

    About the axis of most tilt. Boards that are parallel to one another determine no focal length (Zhang, PAMI 2000).
    """
    seen = problem.seen
    T_world_camera = state.T_world_rig[seen.instant[own]] @ state.T_rig_camera[seen.camera[own]]
    normals = (T_world_camera.inverse() @ state.T_world_board[seen.board[own]]).rotation[..., :, 2]
    scatter = (normals - normals.mean(axis=0)).T @ (normals - normals.mean(axis=0)) / max(len(own), 1)
    return float(np.degrees(np.sqrt(max(np.linalg.eigvalsh(scatter)[-1], 0.0))))


def _uncovered(cells: Flags) -> list[str]:
    """Return a line where corners cover too little of a half of one camera's cells (rows, columns)."""
    halves = zip(
        ("upper half", "lower half", "left half", "right half"),
        (*np.split(cells, 2), *np.split(cells, 2, axis=1)),
        strict=True,
    )
    bare = [f"{side} {100 * part.mean():.0f} %" for side, part in halves if part.mean() < MIN_COVERED]
    return [f"one side only: corners cover of the {' and the '.join(bare)}"] if bare else []


def _differs(validation: Validation, camera: int) -> list[str]:
    halves = validation.halves[camera]
    shift, turn = 1e3 * float(np.linalg.norm(halves[:3])), float(np.degrees(np.linalg.norm(halves[3:])))
    focal = float(abs(validation.focal_halves[camera]))
    told = [f"{100 * focal:.2f} % of the focal length"] if focal > MAX_HALVES_FOCAL else []
    told += [f"{shift:.1f} mm, {turn:.2f} deg"] if shift > MAX_HALVES_MM or turn > MAX_HALVES_DEG else []
    return [f"halves of the images disagree by {', '.join(told)}"] if told else []


def disagreements(names: Sequence[str], singles: Sequence[SingleCamera], lenses: Array) -> list[str]:
    """Return a line for every camera whose joint lens (C, 12) disagrees with its own; one alone has no other."""
    lines = []
    for name, single, lens in zip(names, singles, lenses, strict=True):
        if len(names) > 1 and (chance := lens_chance(single, lens)) < RARE:
            moved = ", ".join(f"{change:+.2f}" for change in (lens - lens_of(single.camera))[:4])
            found = f"fx, fy, cx, cy moved by {moved} px (chance {chance:.1g})"
            lines.append(f"{name}: by itself and with the others it is not the same camera: {found}")
    return [*lines, REMEDY] if lines else []


def lens_chance(single: SingleCamera, lens: Array) -> float:
    """Return how often chance alone would move a lens (12,) so far from the camera's own."""
    free = np.diag(single.lens_covariance) > 0
    scale = np.sqrt(np.diag(single.lens_covariance)[free])
    change = (lens - lens_of(single.camera))[free] / scale
    correlation = single.lens_covariance[np.ix_(free, free)] / scale / scale[:, None]
    if not np.all(np.isfinite(correlation)):
        return 1.0
    return float(chdtrc(int(free.sum()), squared_mahalanobis(change, correlation)))
