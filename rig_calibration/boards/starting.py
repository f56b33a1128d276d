"""From cameras calibrated one by one to a start of the whole rig."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rig_calibration.boards.assembly import Assembly, Sighting, assemble
from rig_calibration.boards.board import Board
from rig_calibration.boards.bundle import residuals
from rig_calibration.boards.checks import check_joined
from rig_calibration.boards.intrinsics import SingleCamera
from rig_calibration.boards.state import AdjustmentProblem, RigState, rig_problem
from rig_calibration.boards.views import BoardView, Observations, observations
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.lens import lens_of


@dataclass(frozen=True, eq=False)
class StartingPoint:
    """Views of the rig with the weights (N,) of their corners, the problem they pose and a state to start from."""

    views: tuple[BoardView, ...]
    problem: AdjustmentProblem
    state: RigState
    kept: Array


def camera_observations(views: Sequence[BoardView], boards: Mapping[str, Board]) -> Observations:
    """Return the views of one camera."""
    zeros, points = [0] * len(views), [boards[view.board].points[view.corners] for view in views]
    return observations(zeros, range(len(views)), zeros, points, [view.pixels for view in views])


def start_of_rig(
    names: Sequence[str],
    boards: Sequence[Board],
    seen: list[Sighting],
    singles: Sequence[SingleCamera],
    T_rig_reference: SE3,
) -> StartingPoint:
    """Join the cameras, keep the views that are joined, number their corners as the rig sees them.

    A board that looks alike after a turn gives one pose for every turn. ValueError names the cameras that stay apart.
    """
    found = assemble(seen, T_rig_reference, len(names))
    check_joined(names, set(found.cameras))
    poses = {i: rigs[0] for i in sorted(found.by_instant) if len((rigs := found.rig_poses(i)).matrix)}
    order = {instant: row for row, instant in enumerate(poses)}
    joined = [s for s in seen if s.instant in poses and s.board in found.boards]
    views = tuple(_turn_view(s, found, poses[s.instant], boards[s.board]) for s in joined)
    camera_of, instant_of, board_of = zip(*((s.camera, order[s.instant], s.board) for s in joined), strict=True)
    points = [boards[s.board].points[view.corners] for s, view in zip(joined, views, strict=True)]
    state = RigState(
        np.stack([lens_of(single.camera) for single in singles]),
        _stack([found.cameras[i] for i in range(len(singles))]),
        _stack([found.boards.get(i, SE3.identity()) for i in range(len(boards))]),
        _stack(list(poses.values())),
    )
    models = tuple(single.camera.model for single in singles)
    sizes = tuple((single.camera.width, single.camera.height) for single in singles)
    reference = min(found.boards, key=lambda i: float(np.abs(found.boards[i].matrix - np.eye(4)).max()))
    observed = observations(camera_of, instant_of, board_of, points, [view.pixels for view in views])
    problem = rig_problem(models, sizes, observed, len(boards), reference)
    is_seen, weights = np.isfinite(residuals(problem, state)[:, 0]), np.concatenate([s.weights for s in joined])
    return StartingPoint(views, problem, state, np.where(is_seen, weights, 0.0))


def _turn_view(sighting: Sighting, found: Assembly, T_world_rig: SE3, board: Board) -> BoardView:
    """Number the corners by the turn of the board that fits where board, camera and rig are."""
    expected = (T_world_rig @ found.cameras[sighting.camera]).inverse() @ found.boards[sighting.board]
    off = np.linalg.norm(sighting.T_camera_board.matrix - expected.matrix, axis=(-2, -1))
    return replace(sighting.view, corners=board.turns[int(np.argmin(off))][sighting.view.corners])


def _stack(poses: list[SE3]) -> SE3:
    return SE3(np.stack([pose.matrix for pose in poses]))
