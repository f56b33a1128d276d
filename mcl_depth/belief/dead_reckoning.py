"""The last place that an image confirmed, propagated by odometry until the next one does."""

from __future__ import annotations

import numpy as np

from mcl_depth.belief.estimate import Hypothesis, Observation
from mcl_depth.belief.motion_model import compose_planar, relative_motion, way_of
from mcl_depth.constants import MIN_TURN, STANDSTILL_NS
from mcl_depth.params import MclInputParams, MotionParams
from sphere_nav.geometry.arrays import Array
from sphere_nav.localization.status import State


class DeadReckoning:
    """Remembers the confirmed place and what odometry said there; a doubtful image changes neither."""

    def __init__(self, params: MclInputParams, motion: MotionParams) -> None:
        self._params, self._noise = params, motion
        self.reset()

    def reset(self) -> None:
        """Forget the place."""
        self.best: Hypothesis | None = None
        self._confirmed: Observation | None = None  # the image that confirmed it
        self._compared: Observation | None = None
        self._stands = self._was_vague = False

    def update(self, best: Hypothesis, observation: Observation, *, is_confirmed: bool) -> None:
        """Take note of an image that was compared; the place counts where the image confirms it."""
        self._stands, self._compared = self._is_close(observation), observation
        if is_confirmed:
            self.best, self._confirmed = best, observation

    def is_near(self, observation: Observation, *, is_sure: bool) -> bool:
        """Whether an image is from nearly the place and heading of the last one: it would tell nothing new.

        Where only odometry says so (not `is_sure`), the first image of a standstill and one a second do tell something.
        """
        if self._compared is None or not self._is_close(observation):
            return False
        return is_sure or (self._stands and observation.stamp_ns - self._compared.stamp_ns < STANDSTILL_NS)

    def _is_close(self, observation: Observation) -> bool:
        motion = _motion(self._compared, observation)
        if motion is None:
            return False
        return abs(motion[2]) < MIN_TURN and way_of(motion) < self._params.min_way

    def propagate(self, observation: Observation) -> tuple[Array, Array]:
        """Return x, y, yaw (3,) at an image and their covariance (3, 3), which grows on the way."""
        assert self.best is not None
        motion = _motion(self._confirmed, observation)
        if motion is None:
            return self.best.pose, self.best.covariance
        way = way_of(motion)
        turn = np.radians(self._noise.drift_deg) * np.sqrt(way)
        side = self._noise.way_share * way + 0.5 * turn * way
        growth = np.diag(np.array([side, side, turn]) ** 2)
        return compose_planar(self.best.pose[None], motion)[0], self.best.covariance + growth

    def is_vague(self, covariance: Array, max_sigma_m: float, state: State) -> bool:
        """Whether a pose with covariance (3, 3) is too vague: what is next may be another room.

        After a way that was too long for one image to be sure, until the place is tracked again.
        """
        if float(np.linalg.eigvalsh(covariance[:2, :2])[-1]) > max_sigma_m**2:
            self._was_vague = True
        elif state is State.TRACKING:
            self._was_vague = False
        return self._was_vague

    @property
    def quality(self) -> float:
        """Share of the belief in the place."""
        return self.best.weight if self.best is not None else 0.0

    def age(self, stamp_ns: int) -> float:
        """Return seconds since an image confirmed the place; 0 before the first."""
        return max((stamp_ns - self._confirmed.stamp_ns) * 1e-9, 0.0) if self._confirmed is not None else 0.0


def _motion(before: Observation | None, observation: Observation) -> Array | None:
    if before is None or before.odometry is None or observation.odometry is None:
        return None
    return relative_motion(before.odometry, observation.odometry)
