"""READ FIRST: from views of boards to a rig, and what is known about how good it is."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rig_calibration.boards.assembly import Sighting, StartingPoint, board_turns, start_of_rig
from rig_calibration.boards.board import Board
from rig_calibration.boards.bundle import RigState
from rig_calibration.boards.intrinsics import SingleCamera, calibrate_camera
from rig_calibration.boards.observability import Spread, spread, warnings
from rig_calibration.boards.quality import disagreements, quality_warnings
from rig_calibration.boards.rejection import adjust
from rig_calibration.boards.validation import Validation, validate
from rig_calibration.boards.views import BoardView, camera_observations
from rig_calibration.constants import MIN_SEEN, MIN_VIEWS
from sphere_nav.geometry import SE3, Camera
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.rig import T_BODY_OPTICAL, Rig, RigCamera
from sphere_nav.geometry.files.untrusted import told_at

Progress = Callable[[str], None]


@dataclass(frozen=True)
class CameraSpec:
    """A camera to calibrate: its model, its image size (width, height) and, where known, a camera to start from."""

    name: str
    model: str
    size: tuple[int, int]
    start: Camera | None = None


@dataclass(frozen=True, eq=False)
class Calibration:
    """The adjusted rig with everything that the report tells about it. Arrays run over cameras in order of `specs`.

    `dropped`: why views were left out, by their label.
    """

    specs: tuple[CameraSpec, ...]
    start: StartingPoint
    state: RigState
    residuals: Array
    kept: Array
    dropped: dict[str, str]
    spread: Spread
    validation: Validation
    warnings: list[str]

    def camera(self, index: int) -> Camera:
        """Return a camera as calibrated."""
        return self.start.problem.camera(self.state, index)

    @property
    def rig(self) -> Rig:
        """The rig, in the frame in which the first camera has the pose it was given."""
        poses = self.state.T_rig_camera
        return Rig(tuple(RigCamera(spec.name, self.camera(i), poses[i]) for i, spec in enumerate(self.specs)))


def calibrate(
    specs: Sequence[CameraSpec],
    boards: Sequence[Board],
    views: Sequence[BoardView],
    T_rig_reference: SE3 = T_BODY_OPTICAL,
    *,
    progress: Progress = lambda _: None,
) -> Calibration:
    """Calibrate lenses and poses of all cameras; the first one stays at `T_rig_reference`.

    ValueError, naming the camera, where one saw no board or is not joined to the first.
    """
    names = [spec.name for spec in specs]
    check_views(names, boards, views)
    singles, seen, dropped = _each_camera(specs, boards, views, progress)
    progress("joining the cameras")
    start = start_of_rig(names, boards, seen, singles, T_rig_reference)
    adjusted = adjust(start.problem, start.state, start.kept, progress)
    state, errors = adjusted.state, adjusted.residuals
    dropped |= {start.views[view].label: reason for view, reason in adjusted.dropped.items()}
    progress("judging: parts of the images")
    found = spread(start.problem, state, errors, adjusted.kept)
    checked = validate(start.problem, state, adjusted.kept)
    notes = warnings(names, found)
    notes += quality_warnings(names, start.problem, state, adjusted.kept, start.views, checked)
    notes += disagreements(names, singles, state.lenses)
    return Calibration(tuple(specs), start, state, errors, adjusted.kept, dropped, found, checked, notes)


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


def _each_camera(
    specs: Sequence[CameraSpec],
    boards: Sequence[Board],
    views: Sequence[BoardView],
    progress: Progress,
) -> tuple[list[SingleCamera], list[Sighting], dict[str, str]]:
    """Calibrate every camera by itself; return the views that fit, and why the others do not."""
    by_name = {board.name: board for board in boards}
    turns = {board.name: board_turns(board).inverse() for board in boards}
    singles, good, dropped = [], [], {}
    for camera, spec in enumerate(specs):
        progress(f"camera {spec.name}")
        own = [view for view in views if view.camera == spec.name and len(view.corners) >= MIN_SEEN]
        seen = camera_observations(own, by_name)
        with told_at(f"camera {spec.name}"):
            single = calibrate_camera(spec.model, spec.size, seen, spec.start)
        singles.append(single)
        T_camera_board = single.adjusted.state.T_world_rig.inverse()
        for index, (view, rows) in enumerate(zip(own, seen.rows, strict=True)):
            weight = single.adjusted.kept[rows]
            if np.any(weight > 0):
                T = T_camera_board[index] @ turns[view.board]
                good.append(Sighting(camera, view.instant, [*by_name].index(view.board), T, view, weight))
            else:
                dropped[view.label] = single.adjusted.dropped.get(index, "no corner fits")
    return singles, good, dropped
