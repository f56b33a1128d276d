"""Small networks: a fork that meets again, a ring, and drives to build them of."""

import math

import numpy as np
import pytest

from path_follower.path import Pose2
from path_follower.routes.building import TaughtDrive, build_network
from path_follower.vehicle import Motion
from path_follower.vehicle import drive as drive_circle
from worlds.curves import even_curve

FORK = [(15, 0), (4, 1 / 8), (8, -1 / 8), (4, 1 / 8), (45, 0)]
RING = [(30, 0), (6 * np.pi / 2, 1 / 6), (20, 0), (6 * np.pi / 2, 1 / 6)]


def make_drive(*pieces, start=(0.0, 0.0, 0.0), left=0.0, direction=1, speed=1.4):
    """Return a drive of (length m, curvature 1/m) pieces, `left` m beside them."""
    poses = [Pose2(*start)]
    for length, bend in pieces:
        count = max(1, round(length / 0.1))
        poses += [
            drive_circle(poses[-1], Motion(1.0, math.atan(bend)), 1.0, (i + 1) * length / count) for i in range(count)
        ]
    x, y, yaw = np.array(poses).T
    speeds = np.full(len(x), speed)
    return TaughtDrive(even_curve(x - left * np.sin(yaw), y + left * np.cos(yaw), yaw, speeds), direction)


@pytest.fixture(scope="session")
def drive():
    return make_drive


@pytest.fixture(scope="session")
def fork():
    """A straight road of 75 m, and a way around a part of it."""
    return build_network([make_drive((75, 0)), make_drive(*FORK, left=0.05)], "campus")


@pytest.fixture(scope="session")
def ring():
    """A ring of 138 m."""
    return build_network([make_drive(*RING, *RING, *RING, *RING, (8, 0))], "campus")
