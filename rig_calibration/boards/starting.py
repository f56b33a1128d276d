"""From cameras calibrated one by one to a start of the whole rig."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rig_calibration.boards.assembly import Assembly, Sighting, board_turns
from rig_calibration.boards.board import Board
from rig_calibration.boards.bundle import residuals
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
    instants: tuple[str, ...]
    problem: AdjustmentProblem
    state: RigState
    kept: Array


def camera_observations(views: Sequence[BoardView], boards: Mapping[str, Board]) -> Observations:
    """Return the views of one camera."""
    numbers = range(len(views))
    zeros = [0] * len(views)
    points = [boards[view.board].points[view.corners] for view in views]
    return observations(zeros, numbers, zeros, points, [view.pixels for view in views])


def sightings(
    views: Sequence[BoardView],
    T_camera_board: SE3,
    cameras: Sequence[str],
    instants: Sequence[str],
    boards: Sequence[Board],
) -> list[Sighting]:
    """Return the views as poses by index; a board that looks alike after a turn gives one pose for every turn."""
    turns = {board.name: board_turns(board) for board in boards}
    names = [board.name for board in boards]
    camera_of, instant_of = ({name: i for i, name in enumerate(items)} for items in (cameras, instants))
    return [
        Sighting(
            camera_of[view.camera],
            instant_of[view.instant],
            names.index(view.board),
            T_camera_board[index] @ turns[view.board].inverse(),
        )
        for index, view in enumerate(views)
    ]


def start_of_rig(
    found: Assembly,
    views: Sequence[BoardView],
    kept: Sequence[Array],
    instants: Sequence[str],
    boards: Sequence[Board],
    singles: Sequence[SingleCamera],
) -> StartingPoint:
    """Keep the views that are joined, number their corners as the rig sees them, and set up the problem."""
    poses = {i: rigs[0] for i in found.by_instant if len((rigs := found.rig_poses(i)).matrix)}
    order = sorted(poses)
    turned, weights, rows = [], [], []
    for view, weight, s in zip(views, kept, found.sightings, strict=True):
        if s.instant in poses and s.board in found.boards:
            turned.append(_turn_view(view, s, found, poses[s.instant], boards[s.board]))
            weights.append(weight)
            rows.append((s.camera, order.index(s.instant), s.board))
    by_name = {board.name: board for board in boards}
    points = [by_name[view.board].points[view.corners] for view in turned]
    camera, instant, board = zip(*rows, strict=True)
    seen = observations(camera, instant, board, points, [view.pixels for view in turned])
    state = RigState(
        np.stack([lens_of(single.camera) for single in singles]),
        _stack([found.cameras[i] for i in range(len(singles))]),
        _stack([found.boards.get(i, SE3.identity()) for i in range(len(boards))]),
        _stack([poses[i] for i in order]),
    )
    models = tuple(single.camera.model for single in singles)
    sizes = tuple((single.camera.width, single.camera.height) for single in singles)
    reference = min(found.boards, key=lambda i: float(np.abs(found.boards[i].matrix - np.eye(4)).max()))
    problem = rig_problem(models, sizes, seen, len(boards), reference)
    weights_all = np.where(np.isfinite(residuals(problem, state)[:, 0]), np.concatenate(weights), 0.0)
    return StartingPoint(tuple(turned), tuple(instants[i] for i in order), problem, state, weights_all)


def _turn_view(view: BoardView, sighting: Sighting, found: Assembly, T_world_rig: SE3, board: Board) -> BoardView:
    """Number the corners by the turn of the board that fits where board, camera and rig are."""
    expected = (T_world_rig @ found.cameras[sighting.camera]).inverse() @ found.boards[sighting.board]
    off = np.linalg.norm(sighting.T_camera_board.matrix - expected.matrix, axis=(-2, -1))
    return replace(view, corners=board.turns[int(np.argmin(off))][view.corners])


def _stack(poses: list[SE3]) -> SE3:
    return SE3(np.stack([pose.matrix for pose in poses]))
