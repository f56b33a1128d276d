"""Small networks: a fork that meets again, a ring, and drives to build them of."""

import numpy as np
import pytest

from path_follower.routes.building import TaughtDrive, build_network
from worlds.curves import even_curve

FORK = [(15, 0), (4, 1 / 8), (8, -1 / 8), (4, 1 / 8), (45, 0)]
RING = [(30, 0), (6 * np.pi / 2, 1 / 6), (20, 0), (6 * np.pi / 2, 1 / 6)]


@pytest.fixture(scope="session")
def drive(kit):
    def make_drive(*pieces, start=(0.0, 0.0, 0.0), left=0.0, direction=1, speed=1.4):
        """Return a drive of (length m, curvature 1/m) pieces, `left` m beside them."""
        x, y, yaw = kit.course(*pieces, step=0.1, start=start).T
        speeds = np.full(len(x), speed)
        return TaughtDrive(even_curve(x - left * np.sin(yaw), y + left * np.cos(yaw), yaw, speeds), direction)

    return make_drive


@pytest.fixture(scope="session")
def fork(drive):
    """A straight road of 75 m, and a way around a part of it."""
    return build_network([drive((75, 0)), drive(*FORK, left=0.05)], "campus")


@pytest.fixture(scope="session")
def ring(drive):
    """A ring of 138 m."""
    return build_network([drive(*RING, *RING, *RING, *RING, (8, 0))], "campus")
