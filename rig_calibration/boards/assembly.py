"""From cameras calibrated one by one to a start of the whole rig, by the pose of every board that a camera saw.

Starting from one camera and one board, whatever is joined to what is known by a common instant is added, by the
candidate that most instants agree with. A camera and a board that only see each other are joined through the
motion of the rig (`hand_eye`). Chessboards that look alike after a turn give one candidate for every turn.

Two unknown poses from many instants, X M_i = A_i Z: a camera and a board that only ever see each other.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares

from rig_calibration.boards.board import Board
from rig_calibration.boards.bundle import AdjustmentProblem, RigState, residuals, rig_problem
from rig_calibration.boards.intrinsics import SingleCamera
from rig_calibration.boards.views import BoardView, observations
from rig_calibration.constants import LOST, MAX_CANDIDATES, MIN_HAND_EYE
from sphere_nav.geometry import SE3, so3
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.cameras.lens import lens_of

Key = tuple[str, int]  # "camera" or "board", and its index


@dataclass(frozen=True, eq=False)
class Sighting:
    """A board seen by a camera at an instant, as its camera alone explains it.

    Camera and board by their indices; `T_camera_board` (K,), one for every turn; weights (n,) of the view's corners.
    """

    camera: int
    instant: str
    board: int
    T_camera_board: SE3
    view: BoardView
    weights: Array

    @property
    def reach(self) -> float:
        """How far away the board is, m."""
        return float(np.linalg.norm(self.T_camera_board.translation[0]))


@dataclass(frozen=True, eq=False)
class Assembly:
    """What is known so far: `T_rig_camera` and `T_world_board` by index, `T_world_rig` by instant."""

    sightings: list[Sighting]
    cameras: dict[int, SE3] = field(default_factory=dict)
    boards: dict[int, SE3] = field(default_factory=dict)

    @cached_property
    def by_instant(self) -> dict[str, list[Sighting]]:
        """What was seen at each instant."""
        grouped = defaultdict(list)
        for sighting in self.sightings:
            grouped[sighting.instant].append(sighting)
        return dict(grouped)

    def rig_poses(self, instant: str) -> SE3:
        """Return candidates (K,) of `T_world_rig`, best first: those that explain the known sightings equally well."""
        known = [s for s in self.by_instant[instant] if s.camera in self.cameras and s.board in self.boards]
        if not known:
            return SE3(np.zeros((0, 4, 4)))
        told = [(self.boards[s.board] @ (self.cameras[s.camera] @ s.T_camera_board).inverse()).matrix for s in known]
        candidates = np.concatenate(told)
        costs = _misfits(candidates, told, float(np.median([s.reach for s in known]))).sum(axis=1)
        order = np.argsort(costs, kind="stable")
        return SE3(candidates[order[costs[order] <= 1.5 * costs.min()]])

    def located(self) -> Iterator[tuple[SE3, Sighting]]:
        """Yield the sightings of instants at which the rig is known, with candidates (K,) of `T_world_rig`."""
        for instant, sightings in self.by_instant.items():
            rigs = self.rig_poses(instant)
            yield from ((rigs, sighting) for sighting in sightings if len(rigs.matrix))


def board_turns(board: Board) -> SE3:
    """Return `T_board_turned` (K,): the motions of the board that put its corners on those of `board.turns`."""
    points, poses = board.points, []
    for moved in board.points[board.turns]:
        R = so3.nearest_rotations((moved - moved.mean(0)).T @ (points - points.mean(0)))
        poses.append(SE3.from_parts(R, moved.mean(0) - R @ points.mean(0)))
    return _stack(poses)


def assemble(sightings: list[Sighting], reference: SE3, num_cameras: int) -> Assembly:
    """Join all to camera 0, whose `T_rig_camera` is `reference`, from a board that it saw: the one that joins most.

    Boards that it saw more often come first, and no other is tried where all cameras are joined. What cannot be joined
    stays out.
    """
    best = Assembly(sightings)
    own = Counter(s.board for s in sightings if s.camera == 0)
    for board, _ in own.most_common():
        found = Assembly(sightings, {0: reference}, {board: SE3.identity()})
        while _grow(found) or (len(found.cameras) < num_cameras and _join_by_motion(found)):
            pass
        best = max(best, found, key=lambda one: len(one.cameras))
        if len(best.cameras) == num_cameras:
            break
    return best


def _grow(found: Assembly) -> bool:
    """Add the camera or board that most instants agree about; return whether there was one."""
    candidates: dict[Key, list[Array]] = defaultdict(list)
    reach: dict[Key, list[float]] = defaultdict(list)
    for rigs, s in found.located():
        if s.camera in found.cameras and s.board not in found.boards:
            key, first, second = ("board", s.board), rigs @ found.cameras[s.camera], s.T_camera_board
        elif s.board in found.boards and s.camera not in found.cameras:
            key, first = ("camera", s.camera), rigs.inverse() @ found.boards[s.board]
            second = s.T_camera_board.inverse()
        else:
            continue
        candidates[key].append((first.matrix[:, None] @ second.matrix).reshape(-1, 4, 4))
        reach[key].append(s.reach)
    agreed = {key: _majority(poses, float(np.median(reach[key]))) for key, poses in candidates.items()}
    if not agreed:
        return False
    kind, index = key = max(agreed, key=lambda key: agreed[key][1])
    (found.cameras if kind == "camera" else found.boards)[index] = agreed[key][0]
    return True


def _join_by_motion(found: Assembly) -> bool:
    """Add the camera and the board that see each other most often, but nothing that is known."""
    pairs: dict[tuple[int, int], list[tuple[SE3, SE3]]] = defaultdict(list)
    for rigs, s in found.located():
        if s.camera not in found.cameras and s.board not in found.boards:
            pairs[s.camera, s.board].append((s.T_camera_board[0], rigs[0].inverse()))
    (camera, board), instants = max(pairs.items(), key=lambda item: len(item[1]), default=((0, 0), []))
    if len(instants) < MIN_HAND_EYE:
        return False
    found.cameras[camera], found.boards[board] = hand_eye(*map(_stack, zip(*instants, strict=True)))
    return True


def hand_eye(M: SE3, A: SE3) -> tuple[SE3, SE3]:
    """Return X and Z of X M_i = A_i Z, of batches (N,), N >= 3.

    Turns from instant to instant give the rotation of X, X (M_i M_j^-1) = (A_i A_j^-1) X, and with it that of Z; a
    refinement gives all twelve numbers. What the motion does not show (a translation along the only axis of rotation)
    stays near zero.
    """
    before = np.roll(np.arange(len(M.matrix)), 1)
    turns = [so3.log((T @ T[before].inverse()).rotation) for T in (A, M)]
    R_X = so3.nearest_rotations(turns[0].T @ turns[1])
    R_Z = so3.nearest_rotations(np.sum(np.swapaxes(A.rotation, 1, 2) @ R_X @ M.rotation, axis=0))
    X, Z = (SE3.from_parts(R, np.zeros(3)) for R in (R_X, R_Z))
    scale = float(np.median(np.linalg.norm(M.translation, axis=-1))) + 1e-9

    def errors(step: Array) -> Array:
        off = (A @ Z @ SE3.exp(step[6:])).inverse() @ (X @ SE3.exp(step[:6]) @ M)
        return np.concatenate([off.translation / scale, so3.log(off.rotation)], axis=-1).ravel()

    step = least_squares(errors, np.zeros(12), loss="soft_l1", f_scale=0.02, max_nfev=40).x
    return X @ SE3.exp(step[:6]), Z @ SE3.exp(step[6:])


def _majority(candidates: list[Array], reach: float) -> tuple[SE3, int]:
    """Return the mean of the candidates that most instants agree about, and how many instants these are."""
    pool = np.concatenate(candidates)
    tried = pool[:: max(len(pool) // MAX_CANDIDATES, 1)]
    best = tried[[int(np.argmin(_misfits(tried, candidates, reach).sum(axis=1)))]]
    apart = [_apart(best, own, reach)[0] for own in candidates]
    distances = np.array([own.min() for own in apart])
    chosen = np.stack([own[int(np.argmin(off))] for own, off in zip(candidates, apart, strict=True)])
    close = chosen[distances <= max(min(2.0 * float(np.median(distances)), LOST), float(distances.min()))]
    R = so3.nearest_rotations(close[:, :3, :3].mean(axis=0))
    return SE3.from_parts(R, np.median(close[:, :3, 3], axis=0)), int(np.count_nonzero(distances <= LOST))


def _misfits(poses: Array, told: list[Array], reach: float) -> Array:
    """Return how far poses (n, 4, 4) are from the nearest of what each of some sightings tells (n, sightings)."""
    return np.stack([np.minimum(_apart(poses, own, reach).min(axis=1), LOST) for own in told], axis=1)


def _apart(first: Array, second: Array, reach: float) -> Array:
    """Return distances (n, m) between poses (n, 4, 4) and (m, 4, 4): by `reach`, plus the angle in radians."""
    trace = first[:, :3, :3].reshape(-1, 9) @ second[:, :3, :3].reshape(-1, 9).T
    moved = np.linalg.norm(first[:, None, :3, 3] - second[None, :, :3, 3], axis=-1)
    return moved / reach + np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))


@dataclass(frozen=True, eq=False)
class StartingPoint:
    """Views of the rig with the weights (N,) of their corners, the problem they pose and a state to start from."""

    views: tuple[BoardView, ...]
    problem: AdjustmentProblem
    state: RigState
    kept: Array


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
    apart = [name for index, name in enumerate(names) if index not in found.cameras]
    if apart:
        together = ", ".join(name for name in names if name not in apart)
        raise ValueError(
            f"cameras: expected all to be joined by boards seen at the same instant, found {', '.join(apart)} "
            f"apart from {together}; images of one instant need the same name or number"
        )
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


def _stack(poses: Iterable[SE3]) -> SE3:
    return SE3(np.stack([pose.matrix for pose in poses]))
