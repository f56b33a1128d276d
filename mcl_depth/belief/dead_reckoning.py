"""The last place found, carried on by odometry between the images that are compared with the map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mcl_depth.belief.estimate import Observation
from mcl_depth.belief.hypotheses import Hypothesis
from mcl_depth.belief.motion_model import compose_planar, planar_pose, relative_motion
from mcl_depth.params import InputParams

Array = NDArray[np.float64]


class DeadReckoning:
    """Remembers the likeliest place, and what odometry said there."""

    def __init__(self, params: InputParams) -> None:
        self._params = params
        self.reset()

    def reset(self) -> None:
        """Forget the place."""
        self.best: Hypothesis | None = None
        self._odometry: Array | None = None
        self._confirmed_ns = 0

    def update(self, best: Hypothesis, observation: Observation, *, is_confirmed: bool) -> None:
        """Remember where an image was taken; `is_confirmed`: it fits there."""
        self.best = best
        self._odometry = planar_pose(observation.T_odom_level) if observation.T_odom_level is not None else None
        self._confirmed_ns = observation.stamp_ns if is_confirmed else self._confirmed_ns

    def is_near(self, observation: Observation) -> bool:
        """Whether an image is from nearly the place and heading of the last one: it would tell nothing new."""
        motion = self._motion(observation)
        if motion is None:
            return False
        is_turned = abs(motion[2]) >= np.radians(self._params.min_turn_deg)
        return not is_turned and float(np.hypot(motion[0], motion[1])) < self._params.min_way

    def propagate(self, observation: Observation) -> Array:
        """Return x, y, yaw (3,) at an image: that of the last one, moved by odometry."""
        assert self.best is not None
        motion = self._motion(observation)
        return compose_planar(self.best.pose[None], motion)[0] if motion is not None else self.best.pose

    @property
    def quality(self) -> float:
        """Share of the belief in the place."""
        return self.best.weight if self.best is not None else 0.0

    def age(self, stamp_ns: int) -> float:
        """Return seconds since an image confirmed the place; 0 before the first."""
        return max((stamp_ns - self._confirmed_ns) * 1e-9, 0.0) if self._confirmed_ns else 0.0

    def _motion(self, observation: Observation) -> Array | None:
        if self.best is None or self._odometry is None or observation.T_odom_level is None:
            return None
        return relative_motion(self._odometry, planar_pose(observation.T_odom_level))
