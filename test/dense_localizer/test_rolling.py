"""A camera that turns while it is read is localised as well as one with a global shutter."""

from itertools import pairwise

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from worlds.localizer import Run, at, error, make_localizer

pytestmark = pytest.mark.slow

READOUT_S = 0.034  # 0.68 of the time between two images
TURN = np.radians(1.2)  # an image


def errors_of(room, room_map, readout_s, known_s):
    """Return metres and radians (N, 2) of a camera that turns by 1.2 deg an image, after it has been found."""
    run = Run(room, make_localizer(room_map, camera__readout=known_s))
    run.follow([at(-1.6)] * 6)
    poses = [at(-1.6) @ SE3.exp([0.0, 0.0, 0.0, 0.3 * TURN * k, TURN * k, 0.0]) for k in range(13)]
    found = [run.sweep(*pair, readout_s) for pair in pairwise(poses)]
    return np.array([error(*pair) for pair in zip(found, poses[1:], strict=True)][2:])


def test_known_readout_costs_nothing_and_unknown_costs_much(room, room_map):
    still = np.median(errors_of(room, room_map, 0.0, 0.0), axis=0)
    known = np.median(errors_of(room, room_map, READOUT_S, READOUT_S), axis=0)
    unknown = np.median(errors_of(room, room_map, READOUT_S, 0.0), axis=0)
    assert np.all(known < 1.3 * still + (0.001, 0.0005))  # a millimetre: a tenth of a pixel of these small images
    assert np.all(unknown > 2.0 * known)
