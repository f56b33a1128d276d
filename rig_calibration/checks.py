"""What is wrong with the input, told before anything is calibrated."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from rig_calibration.board import Board
from rig_calibration.params import CalibrationParams
from rig_calibration.views import View


def check_views(
    cameras: Sequence[str], boards: Sequence[Board], views: Sequence[View], params: CalibrationParams
) -> None:
    """Raise ValueError where no board was found at all, or too rarely by one camera."""
    sizes = ", ".join(f"{board.columns}x{board.rows} {board.kind}" for board in boards)
    hint = "a board is counted in inner corners, one less than squares"
    if not views:
        raise ValueError(f"boards: expected a {sizes} in some images, found none in any of them; {hint}")
    count = Counter(view.camera for view in views if len(view.corners) >= params.min_corners)
    for name in cameras:
        if not count[name]:
            raise ValueError(f"camera {name}: expected a {sizes} in some of its images, found none")
        if count[name] < params.min_views:
            raise ValueError(
                f"camera {name}: expected a board in at least {params.min_views} of its images, found {count[name]}"
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
