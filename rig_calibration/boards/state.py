"""What the adjustment looks for: lenses, where the cameras sit, where the boards hang, where the rig was."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rig_calibration.boards.views import Observations
from rig_calibration.constants import NUM_DISTORTION
from sphere_nav.geometry import SE3, Camera, so3
from sphere_nav.geometry.arrays import Array, Flags
from sphere_nav.geometry.cameras.lens import NUM_LENS, camera_of, free_parameters

SHARED = NUM_LENS + 6  # parameters of a camera: lens, then along and about the axes of the rig


@dataclass(frozen=True, eq=False)
class RigState:
    """Lenses (C, 12), `T_rig_camera` (C,), `T_world_board` (B,) and `T_world_rig` (I,), one for every instant."""

    lenses: Array
    T_rig_camera: SE3
    T_world_board: SE3
    T_world_rig: SE3

    def moved(self, step: Array) -> RigState:
        """Add a step (18 C + 6 B + 6 I,) of cameras, boards and rig poses.

        Cameras move along and turn about the axes of the rig; tangents of the others act from the right.
        """
        lenses, boards = SHARED * len(self.lenses), 6 * len(self.T_world_board.matrix)
        lens, move, turn = np.split(step[:lenses].reshape(-1, SHARED), [NUM_LENS, NUM_LENS + 3], axis=1)
        return RigState(
            self.lenses + lens,
            SE3.from_parts(so3.exp(turn) @ self.T_rig_camera.rotation, self.T_rig_camera.translation + move),
            self.T_world_board @ SE3.exp(step[lenses : lenses + boards].reshape(-1, 6)),
            self.T_world_rig @ SE3.exp(step[lenses + boards :].reshape(-1, 6)),
        )


@dataclass(frozen=True, eq=False)
class AdjustmentProblem:
    """Observations, and which of the shared parameters (18 C + 6 B,) may move; rig poses always may."""

    models: tuple[str, ...]
    sizes: tuple[tuple[int, int], ...]
    seen: Observations
    is_free: Flags

    @property
    def num_shared(self) -> int:
        """Number of the shared parameters."""
        return len(self.is_free)

    def camera(self, state: RigState, index: int) -> Camera:
        """Return a camera as its model."""
        return camera_of(self.models[index], self.sizes[index], state.lenses[index], NUM_DISTORTION)

    def held(self) -> AdjustmentProblem:
        """Return the problem with all shared parameters held."""
        return replace(self, is_free=np.zeros_like(self.is_free))


def rig_problem(
    models: tuple[str, ...],
    sizes: tuple[tuple[int, int], ...],
    seen: Observations,
    num_boards: int = 1,
    reference_board: int = 0,
) -> AdjustmentProblem:
    """Return the whole problem; the first camera and one board stay where they are, to hold rig and world."""
    lenses = [free_parameters(model, NUM_DISTORTION) for model in models]
    cameras = [np.concatenate([lens, np.full(6, index > 0)]) for index, lens in enumerate(lenses)]
    boards = [np.full(6, index != reference_board) for index in range(num_boards)]
    return AdjustmentProblem(models, sizes, seen, np.concatenate([*cameras, *boards]))


def camera_state(lens: Array, T_camera_board: SE3) -> RigState:
    """Return the state of a rig of one camera; a rig pose is the camera's in the frame of the board it sees."""
    origin = SE3(np.eye(4)[None])
    return RigState(lens[None], origin, origin, T_camera_board.inverse())
