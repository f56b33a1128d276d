"""Which images of a drive may teach the map something: those with a pose, spread over the way, explained or not.

An image is explained where the map placed it, the pose is trusted, and the two look alike. A drive is a lesson where
the map explained less than four fifths of its key images: it was tracked, but badly.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from dense_localizer.constants import (
    KEY_MEMORY,
    KEY_REACH,
    KEY_TURN,
    MAX_KEY_SIGMA_M,
    MIN_EXPLAINED_NCC,
    MIN_EXPLAINED_SHARE,
    MIN_KEY_IMAGES,
)
from dense_localizer.judge.estimate import CameraEstimate
from dense_localizer.motion_prior import measure_position_sigma
from sphere_nav.geometry import SE3
from sphere_nav.localization.status import State


class KeyImages:
    """Chooses the key images of a drive; those that the map explained and those that it did not, each for themselves.

    Else a place that was explained once would never be seen in another light.
    """

    def __init__(self) -> None:
        self._kept: dict[bool, deque[SE3]] = {kind: deque(maxlen=KEY_MEMORY) for kind in (True, False)}

    def choose(self, estimate: CameraEstimate) -> bool:
        """Say whether an image is a key image: it was placed, surely, and away from the key images before it."""
        candidate, covariance, pose = estimate.candidate, estimate.covariance, estimate.T_map_camera
        if pose is None or covariance is None or candidate is None or not candidate.is_accepted:
            return False
        if measure_position_sigma(covariance) > MAX_KEY_SIGMA_M or not np.isfinite(candidate.choice.region_m):
            return False
        kept, reach = self._kept[is_explained(estimate)], KEY_REACH * candidate.choice.region_m
        if kept:
            meters, radians = SE3(np.array([one.matrix for one in kept])).distance(pose)
            if np.any((meters <= reach) & (radians <= KEY_TURN)):
                return False
        kept.append(pose)
        return True


def is_lesson(explained: Sequence[bool]) -> bool:
    """Say whether a drive was tracked, but badly, by whether the map explained each of its key images."""
    return len(explained) >= MIN_KEY_IMAGES and sum(explained) < MIN_EXPLAINED_SHARE * len(explained)


def is_explained(estimate: CameraEstimate) -> bool:
    """Say whether the map explains an image."""
    return estimate.status.state is State.TRACKING and is_alike(estimate)


def is_alike(estimate: CameraEstimate) -> bool:
    """Say whether an image looks like the map where this has placed it, whether that is trusted or not."""
    candidate = estimate.candidate
    return candidate is not None and candidate.is_by_map and candidate.ncc >= MIN_EXPLAINED_NCC
