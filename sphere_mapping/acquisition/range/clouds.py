"""The newest clouds of a LiDAR, by their stamps, and where it is mounted."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from sphere_mapping.acquisition.params import CloudParams
from sphere_nav.geometry import SE3

Points = NDArray[np.float32]

KEPT = 8


class Clouds:
    """Keeps a few clouds (N, 3) in the frame of the rig; hands out the one that belongs to an instant."""

    def __init__(self, params: CloudParams) -> None:
        self._max_age_ns = params.max_age_s * 1e9
        self._kept: deque[tuple[int, Points]] = deque(maxlen=KEPT)

    def clear(self) -> None:
        """Forget all: the clock jumped."""
        self._kept.clear()

    def add(self, stamp_ns: int, points: Points) -> None:
        """Keep a cloud, in place of the oldest."""
        self._kept.append((stamp_ns, points))

    def has_since(self, stamp_ns: int) -> bool:
        """Whether a cloud of this time or later is there: no nearer one can come."""
        return any(stamp >= stamp_ns for stamp, _ in self._kept)

    def at(self, stamp_ns: int) -> Points | None:
        """Return the cloud nearest in time, None where it is too far away."""
        nearest = min(self._kept, key=lambda cloud: abs(cloud[0] - stamp_ns), default=None)
        return None if nearest is None or abs(nearest[0] - stamp_ns) > self._max_age_ns else nearest[1]


def mount_of(params: CloudParams) -> SE3:
    """Return T_rig_points of the parameters: turned about x, then y, then z, all of the rig."""
    roll, pitch, yaw = np.radians([params.roll_deg, params.pitch_deg, params.yaw_deg])
    return SE3.from_angles(roll, pitch, yaw, [params.x, params.y, params.z])
