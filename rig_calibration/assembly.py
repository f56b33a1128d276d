"""Where cameras, boards and rig roughly are, from the pose of every board that a camera saw.

Starting from one camera and one board, whatever is joined to what is known by a common instant is added, by the
candidate that most instants agree with. A camera and a board that only see each other are joined through the
motion of the rig (`hand_eye`). Chessboards that look alike after a turn give one candidate for every turn.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rig_calibration.board import Board
from rig_calibration.hand_eye import hand_eye
from sphere_geometry import SE3, so3

Array = NDArray[np.float64]

MIN_HAND_EYE = 4
MAX_CANDIDATES = 400


@dataclass(frozen=True, eq=False)
class Sighting:
    """A board seen by a camera at an instant, by their indices: `T_camera_board` (K,), one for every turn."""

    camera: int
    instant: int
    board: int
    T_camera_board: SE3


@dataclass
class Assembly:
    """What is known so far: `T_rig_camera` and `T_world_board` by index, `T_world_rig` by instant."""

    sightings: list[Sighting]
    cameras: dict[int, SE3] = field(default_factory=dict)
    boards: dict[int, SE3] = field(default_factory=dict)
    by_instant: dict[int, list[Sighting]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        grouped = defaultdict(list)
        for sighting in self.sightings:
            grouped[sighting.instant].append(sighting)
        self.by_instant = dict(grouped)

    def rig_poses(self, instant: int) -> list[SE3]:
        """Return candidates of `T_world_rig`, best first: those that explain the known sightings equally well."""
        known = [s for s in self.by_instant[instant] if s.camera in self.cameras and s.board in self.boards]
        candidates = [
            SE3(matrix)
            for s in known
            for matrix in (self.boards[s.board] @ (self.cameras[s.camera] @ s.T_camera_board).inverse()).matrix
        ]
        if len(known) < 2:
            return candidates
        costs = [max(self._misfit(T, s) for s in known) for T in candidates]
        best = min(costs)
        return [candidates[i] for i in np.argsort(costs) if costs[i] <= 1.5 * best + 1e-6]

    def _misfit(self, T_world_rig: SE3, sighting: Sighting) -> float:
        seen = T_world_rig @ self.cameras[sighting.camera] @ sighting.T_camera_board
        return float(np.min(_distance(seen, self.boards[sighting.board], _reach(sighting))))


def board_turns(board: Board) -> SE3:
    """Return `T_board_turned` (K,): the motions of the board that put its corners on those of `board.turns`."""
    poses = []
    for turn in board.turns:
        points, moved = board.points, board.points[turn]
        U, _, Vt = np.linalg.svd((moved - moved.mean(0)).T @ (points - points.mean(0)))
        R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
        poses.append(SE3.from_parts(R, moved.mean(0) - R @ points.mean(0)).matrix)
    return SE3(np.stack(poses))


def assemble(sightings: list[Sighting], reference: SE3, num_cameras: int, rng: np.random.Generator) -> Assembly:
    """Join everything to camera 0, whose `T_rig_camera` is `reference`; what cannot be joined stays out."""
    found = Assembly(sightings)
    own = [s.board for s in sightings if s.camera == 0]
    if not own:
        return found
    found.cameras[0] = reference
    found.boards[int(np.bincount(own).argmax())] = SE3.identity()
    while _grow(found) or (len(found.cameras) < num_cameras and _join_by_motion(found, rng)):
        pass
    return found


def _grow(found: Assembly) -> bool:
    """Add the camera or board that most instants join to what is known; return whether there was one."""
    candidates: dict[tuple[str, int], list[SE3]] = defaultdict(list)
    reach: dict[tuple[str, int], list[float]] = defaultdict(list)
    for instant, sightings in found.by_instant.items():
        T_world_rigs = found.rig_poses(instant)
        if not T_world_rigs:
            continue
        rigs = SE3(np.stack([T.matrix for T in T_world_rigs]))
        for s in sightings:
            if s.camera not in found.cameras and s.board in found.boards:
                key, poses = ("camera", s.camera), _all(rigs.inverse() @ found.boards[s.board], s.T_camera_board, True)
            elif s.camera in found.cameras and s.board not in found.boards:
                key, poses = ("board", s.board), _all(rigs @ found.cameras[s.camera], s.T_camera_board, False)
            else:
                continue
            candidates[key].append(poses)
            reach[key].append(_reach(s))
    if not candidates:
        return False
    kind, index = max(candidates, key=lambda key: len(candidates[key]))
    known = found.cameras if kind == "camera" else found.boards
    known[index] = _agreed(candidates[(kind, index)], float(np.median(reach[(kind, index)])))
    return True


def _join_by_motion(found: Assembly, rng: np.random.Generator) -> bool:
    pairs: dict[tuple[int, int], list[tuple[SE3, SE3]]] = defaultdict(list)
    for instant, sightings in found.by_instant.items():
        rigs = found.rig_poses(instant)
        for s in sightings if rigs else []:
            if s.camera not in found.cameras and s.board not in found.boards:
                pairs[(s.camera, s.board)].append((s.T_camera_board[0], rigs[0].inverse()))
    if not pairs:
        return False
    (camera, board), instants = max(pairs.items(), key=lambda item: len(item[1]))
    if len(instants) < MIN_HAND_EYE:
        return False
    M, A = (SE3(np.stack([pair[k].matrix for pair in instants])) for k in (0, 1))
    found.cameras[camera], found.boards[board], _ = hand_eye(M, A, rng)
    return True


def _all(first: SE3, second: SE3, is_inverted: bool) -> SE3:
    """Return every product (n * m,) of two batches, the second inverted if told so."""
    second = second.inverse() if is_inverted else second
    return SE3((first.matrix[:, None] @ second.matrix).reshape(-1, 4, 4))


def _agreed(candidates: list[SE3], reach: float) -> SE3:
    """Return the candidate whose median distance to the nearest one of every instant is least, then their mean."""
    pool = np.concatenate([T.matrix for T in candidates])
    pool = pool[:: max(len(pool) // MAX_CANDIDATES, 1)]
    costs = [np.median([np.min(_distance(T, SE3(matrix), reach)) for T in candidates]) for matrix in pool]
    best = SE3(pool[int(np.argmin(costs))])
    nearest = [T.matrix[int(np.argmin(_distance(T, best, reach)))] for T in candidates]
    distances = np.array([float(_distance(SE3(matrix), best, reach)) for matrix in nearest])
    close = np.stack(nearest)[distances <= 2.0 * np.median(distances) + 1e-9]
    U, _, Vt = np.linalg.svd(close[:, :3, :3].mean(axis=0))
    return SE3.from_parts(U @ Vt, np.median(close[:, :3, 3], axis=0))


def _distance(T: SE3, other: SE3, reach: float) -> Array:
    between = np.swapaxes(T.rotation, -1, -2) @ other.rotation
    angle = np.linalg.norm(so3.log(between), axis=-1)
    moved: Array = np.linalg.norm(T.translation - other.translation, axis=-1) / reach + angle
    return moved


def _reach(sighting: Sighting) -> float:
    return float(np.linalg.norm(sighting.T_camera_board.translation[0])) + 1e-9
