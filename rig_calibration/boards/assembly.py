"""Where cameras, boards and rig roughly are, from the pose of every board that a camera saw.

Starting from one camera and one board, whatever is joined to what is known by a common instant is added, by the
candidate that most instants agree with. A camera and a board that only see each other are joined through the
motion of the rig (`hand_eye`). Chessboards that look alike after a turn give one candidate for every turn.

Two unknown poses from many instants, X M_i = A_i Z: a camera and a board that only ever see each other.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import least_squares

from rig_calibration.boards.board import Board
from rig_calibration.constants import (
    LOST,
    MAX_CANDIDATES,
    MIN_HAND_EYE,
    MIN_INSTANTS,
    NUM_ALTERNATIONS,
    NUM_REFINED,
    NUM_STARTS,
    NUM_SWEEPS,
)
from sphere_nav.geometry import SE3, so3
from sphere_nav.geometry.arrays import Array


def hand_eye(M: SE3, A: SE3, rng: np.random.Generator) -> tuple[SE3, SE3, float]:
    """Return X and Z of X M_i = A_i Z and the RMS of what remains, in metres and radians alike.

    `M` and `A` are batches (N,), N >= 3. All twelve numbers are refined from the best of many starts. What the motion
    does not show (a translation along the only axis of rotation) stays near zero.
    """
    starts = [_start(M, A, R_X) for R_X in so3.from_quaternion(rng.normal(size=(NUM_STARTS, 4)))]
    scale = float(np.median(np.linalg.norm(M.translation, axis=-1))) + 1e-9
    starts.sort(key=lambda start: start[2])
    return min((_refine(M, A, X, Z, scale) for X, Z, _ in starts[:NUM_REFINED]), key=lambda found: found[2])


def _start(M: SE3, A: SE3, R_X: Array) -> tuple[SE3, SE3, float]:
    """Return X and Z near a rotation of X, by alternation, their translations by least squares, and what remains."""
    for _ in range(NUM_ALTERNATIONS):
        R_Z = so3.nearest_rotations(np.sum(np.swapaxes(A.rotation, 1, 2) @ R_X @ M.rotation, axis=0))
        R_X = so3.nearest_rotations(np.sum(A.rotation @ R_Z @ np.swapaxes(M.rotation, 1, 2), axis=0))
    left = np.concatenate([np.broadcast_to(np.eye(3), M.rotation.shape), -A.rotation], axis=-1).reshape(-1, 6)
    right = (A.translation - np.einsum("ij,nj->ni", R_X, M.translation)).ravel()
    t = np.linalg.lstsq(left, right, rcond=1e-6)[0]
    X, Z = SE3.from_parts(R_X, t[:3]), SE3.from_parts(R_Z, t[3:])
    return X, Z, float(np.linalg.norm((X @ M).matrix - (A @ Z).matrix))


def _refine(M: SE3, A: SE3, X: SE3, Z: SE3, scale: float) -> tuple[SE3, SE3, float]:
    def errors(step: Array) -> Array:
        difference = (A @ Z @ SE3.exp(step[6:])).inverse() @ (X @ SE3.exp(step[:6]) @ M)
        turn = so3.log(difference.rotation)
        return np.concatenate([difference.translation / scale, turn], axis=-1).ravel()

    best = least_squares(errors, np.zeros(12), loss="soft_l1", f_scale=0.02, max_nfev=40)
    rms = float(np.sqrt(2.0 * best.cost / M.matrix.shape[0]))
    return X @ SE3.exp(best.x[:6]), Z @ SE3.exp(best.x[6:]), rms


Key = tuple[str, int]  # "camera" or "board", and its index


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

    def place(self, key: Key, pose: SE3) -> None:
        """Take a pose for a camera or a board."""
        (self.cameras if key[0] == "camera" else self.boards)[key[1]] = pose

    def without(self, key: Key) -> Assembly:
        """Return the same without the pose of a camera or a board."""
        cameras = {c: T for c, T in self.cameras.items() if key != ("camera", c)}
        return Assembly(self.sightings, cameras, {b: T for b, T in self.boards.items() if key != ("board", b)})

    def rig_poses(self, instant: int) -> list[SE3]:
        """Return candidates of `T_world_rig`, best first: those that explain the known sightings equally well."""
        known = [s for s in self.by_instant[instant] if s.camera in self.cameras and s.board in self.boards]
        if not known:
            return []
        placed = [self.boards[s.board] @ (self.cameras[s.camera] @ s.T_camera_board).inverse() for s in known]
        candidates = np.concatenate([T.matrix for T in placed])
        if len(known) > 1:
            costs = np.sum([np.minimum(self._misfits(candidates, s), LOST) for s in known], axis=0)
            order = np.argsort(costs, kind="stable")
            candidates = candidates[order[costs[order] <= 1.5 * costs.min() + 1e-6]]
        return [SE3(matrix) for matrix in candidates]

    def num_lost(self) -> int:
        """Return how many sightings are far from where they should be, or join nothing."""
        count = 0
        for instant, sightings in self.by_instant.items():
            poses = self.rig_poses(instant)
            known = [s for s in sightings if s.camera in self.cameras and s.board in self.boards]
            count += len(sightings) - len(known)
            count += sum(float(self._misfits(poses[0].matrix[None], s)[0]) >= LOST for s in known)
        return count

    def _misfits(self, T_world_rigs: Array, sighting: Sighting) -> Array:
        """Return how far the board would be from where it is (n,), for rig poses (n, 4, 4), by its nearest turn."""
        seen = (self.cameras[sighting.camera] @ sighting.T_camera_board).matrix
        apart = _apart(
            (T_world_rigs[:, None] @ seen).reshape(-1, 4, 4), self.boards[sighting.board].matrix[None], _reach(sighting)
        )
        return apart.reshape(len(T_world_rigs), -1).min(axis=1)


def board_turns(board: Board) -> SE3:
    """Return `T_board_turned` (K,): the motions of the board that put its corners on those of `board.turns`."""
    poses = []
    for turn in board.turns:
        points, moved = board.points, board.points[turn]
        R = so3.nearest_rotations((moved - moved.mean(0)).T @ (points - points.mean(0)))
        poses.append(SE3.from_parts(R, moved.mean(0) - R @ points.mean(0)).matrix)
    return SE3(np.stack(poses))


def assemble(sightings: list[Sighting], reference: SE3, num_cameras: int, rng: np.random.Generator) -> Assembly:
    """Join everything to camera 0, whose `T_rig_camera` is `reference`; what cannot be joined stays out.

    The first step may rest on one instant and a false view there. So every board that camera 0 saw is tried as the
    first one, and the assembly that most sightings agree with is taken.
    """
    own = np.bincount([s.board for s in sightings if s.camera == 0] or [0])
    if not any(s.camera == 0 for s in sightings):
        return Assembly(sightings)
    tried: list[tuple[int, int, Assembly]] = []
    for board in np.argsort(-own)[: np.count_nonzero(own)]:
        found = Assembly(sightings, {0: reference}, {int(board): SE3.identity()})
        while _grow(found) or (len(found.cameras) < num_cameras and _join_by_motion(found, rng)):
            pass
        if found.num_lost():
            _settle(found, int(board))
        tried.append((found.num_lost(), len(tried), found))
        if not tried[-1][0]:
            break
    return min(tried)[2]


def _grow(found: Assembly) -> bool:
    """Add the camera or board that most instants agree about; return whether there was one."""
    seen = _propose(found)
    agreed = {key: _majority(*instants) for key, instants in seen.items()}
    if not agreed:
        return False
    key = max(agreed, key=lambda key: agreed[key][1])
    found.place(key, agreed[key][0])
    return True


def _settle(found: Assembly, reference_board: int) -> None:
    """Place every camera and board once more, by all instants; the first placing may have rested on a false view."""
    for _ in range(NUM_SWEEPS):
        for key in [*(("camera", c) for c in found.cameras), *(("board", b) for b in found.boards)]:
            if key in (("camera", 0), ("board", reference_board)):
                continue
            kept = found.without(key)
            instants = _propose(kept).get(key)
            if instants is not None and len(instants[0]) >= MIN_INSTANTS:
                found.place(key, _majority(*instants)[0])


def _propose(found: Assembly) -> dict[Key, tuple[list[SE3], float]]:
    """Return, for cameras and boards that are not placed, where each instant puts them, and how far away they are."""
    candidates: dict[Key, list[SE3]] = defaultdict(list)
    reach: dict[Key, list[float]] = defaultdict(list)
    for instant, sightings in found.by_instant.items():
        wanted = [s for s in sightings if (s.camera in found.cameras) != (s.board in found.boards)]
        T_world_rigs = found.rig_poses(instant) if wanted else []
        if not T_world_rigs:
            continue
        rigs = SE3(np.stack([T.matrix for T in T_world_rigs]))
        for s in wanted:
            if s.board in found.boards:
                key, poses = ("camera", s.camera), _all(rigs.inverse() @ found.boards[s.board], s.T_camera_board, True)
            else:
                key, poses = ("board", s.board), _all(rigs @ found.cameras[s.camera], s.T_camera_board, False)
            candidates[key].append(poses)
            reach[key].append(_reach(s))
    return {key: (poses, float(np.median(reach[key]))) for key, poses in candidates.items()}


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


def _majority(candidates: list[SE3], reach: float) -> tuple[SE3, int]:
    """Return the mean of the candidates that most instants agree about, and how many instants these are."""
    pool = np.concatenate([T.matrix for T in candidates])
    first = np.cumsum([0, *(len(T.matrix) for T in candidates[:-1])])
    tried = pool[:: max(len(pool) // MAX_CANDIDATES, 1)]
    apart = _apart(tried, pool, reach)
    nearest = np.minimum.reduceat(apart, first, axis=1)  # (tried, instants)
    best = int(np.argmin(np.sum(np.minimum(nearest, LOST), axis=1)))
    chosen = [start + int(np.argmin(row)) for start, row in zip(first, np.split(apart[best], first[1:]), strict=True)]
    distances = apart[best][chosen]
    is_close = distances <= min(2.0 * float(np.median(distances)) + 1e-9, LOST)
    close = pool[chosen][is_close if is_close.any() else distances == distances.min()]
    U, _, Vt = np.linalg.svd(close[:, :3, :3].mean(axis=0))
    mean = SE3.from_parts(U @ Vt, np.median(close[:, :3, 3], axis=0))
    return mean, int(np.count_nonzero(distances <= LOST))


def _apart(first: Array, second: Array, reach: float) -> Array:
    """Return distances (n, m) between poses (n, 4, 4) and (m, 4, 4): by `reach`, plus the angle in radians."""
    trace = first[:, :3, :3].reshape(-1, 9) @ second[:, :3, :3].reshape(-1, 9).T
    moved = np.linalg.norm(first[:, None, :3, 3] - second[None, :, :3, 3], axis=-1)
    apart: Array = moved / reach + np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))
    return apart


def _reach(sighting: Sighting) -> float:
    return float(np.linalg.norm(sighting.T_camera_board.translation[0])) + 1e-9
