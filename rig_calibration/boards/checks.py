"""What is wrong with the input, told before anything is calibrated.

Whether the joint adjustment says of every camera what its own images say: if not, instants were none.

Where images that are taken for one instant were not taken at one, the rig cannot be rigid in the adjustment, and lenses
bear it. The test raises a false alarm once in a thousand calibrations of a camera, by chi2: the joint estimate is the
better one, so their difference varies less than the single one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from scipy.special import chdtrc

from rig_calibration.boards.board import Board
from rig_calibration.boards.intrinsics import SingleCamera
from rig_calibration.boards.views import BoardView
from rig_calibration.constants import (
    FALSE_ALARM,
    MIN_SEEN,
    MIN_VIEWS,
)
from sphere_nav.estimation.gates import squared_mahalanobis
from sphere_nav.geometry.arrays import Array

REMEDY = "were the images of each instant taken at one time, with board and rig at rest?"


def disagreements(names: Sequence[str], singles: Sequence[SingleCamera], lenses: Array) -> list[str]:
    """Return a line for every camera whose joint lens (C, 12) disagrees with its own; one alone has no other."""
    lines = []
    for name, single, lens in zip(names, singles, lenses, strict=True):
        if len(names) > 1 and (chance := lens_chance(single, lens)) < FALSE_ALARM:
            moved = ", ".join(f"{change:+.2f}" for change in (lens - single.lens)[:4])
            found = f"fx, fy, cx, cy moved by {moved} px (chance {chance:.1g})"
            lines.append(f"{name}: by itself and with the others it is not the same camera: {found}")
    return [*lines, REMEDY] if lines else []


def lens_chance(single: SingleCamera, lens: Array) -> float:
    """Return how often chance alone would move a lens (12,) so far from the camera's own."""
    free = np.diag(single.lens_covariance) > 0
    scale = np.sqrt(np.diag(single.lens_covariance)[free])
    change = (lens - single.lens)[free] / scale
    correlation = single.lens_covariance[np.ix_(free, free)] / scale / scale[:, None]
    if not np.all(np.isfinite(correlation)):
        return 1.0
    return float(chdtrc(int(free.sum()), squared_mahalanobis(change, correlation)))


def check_views(cameras: Sequence[str], boards: Sequence[Board], views: Sequence[BoardView]) -> None:
    """Raise ValueError where no board was found at all, or too rarely by one camera."""
    sizes = ", ".join(f"{board.columns}x{board.rows} {board.kind}" for board in boards)
    hint = "a board is counted in inner corners, one less than squares"
    if not views:
        raise ValueError(f"boards: expected a {sizes} in some images, found none in any of them; {hint}")
    count = Counter(view.camera for view in views if len(view.corners) >= MIN_SEEN)
    for name in cameras:
        if not count[name]:
            raise ValueError(f"camera {name}: expected a {sizes} in some of its images, found none")
        if count[name] < MIN_VIEWS:
            raise ValueError(
                f"camera {name}: expected a board in at least {MIN_VIEWS} of its images, found {count[name]}"
            )
    numbers = {board.name: board.num_corners for board in boards}
    for view in views:
        if view.board not in numbers or len(view.corners) != len(view.pixels) or not np.all(np.isfinite(view.pixels)):
            raise ValueError(f"view {view.label}: expected finite corners of a known board")


def check_joined(cameras: Sequence[str], joined: set[int]) -> None:
    """Raise ValueError naming the cameras that nothing joins to the first one."""
    apart = [name for index, name in enumerate(cameras) if index not in joined]
    if apart:
        together = ", ".join(name for index, name in enumerate(cameras) if index in joined)
        raise ValueError(
            f"cameras: expected all to be joined by boards seen at the same instant, found {', '.join(apart)} "
            f"apart from {together}; images of one instant need the same name or number"
        )
