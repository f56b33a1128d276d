"""Small networks: a fork that meets again, a ring, and drives to build them of."""

import numpy as np
import pytest

from path_follower.routes.building import Drive, build_network, even_curve

FORK = [(15, 0), (4, 1 / 8), (8, -1 / 8), (4, 1 / 8), (45, 0)]
RING = [(30, 0), (6 * np.pi / 2, 1 / 6), (20, 0), (6 * np.pi / 2, 1 / 6)]


@pytest.fixture
def drive(kit):
    """Make a drive of (length m, curvature 1/m) pieces, `left` m beside them."""

    def make(*pieces, start=(0.0, 0.0, 0.0), left=0.0, direction=1, speed=1.4):
        x, y, yaw = kit.course(*pieces, start=start, step=0.1).T
        speeds = np.full(len(x), speed)
        return Drive(even_curve(x - left * np.sin(yaw), y + left * np.cos(yaw), yaw, speeds), direction)

    return make


@pytest.fixture
def fork(drive):
    """A straight road of 75 m, and a way around a part of it."""
    return build_network([drive((75, 0)), drive(*FORK, left=0.05)], "campus", 1.2)


@pytest.fixture
def ring(drive):
    """A ring of 138 m."""
    return build_network([drive(*RING, *RING, (8, 0))], "campus", 1.2)
