"""The motion that bent a sphere and the motion that is found agree in the end."""

from types import SimpleNamespace

import numpy as np

from sphere_mapping.graph.motion import DriveMotion, Placed
from sphere_mapping.graph.tracking import align_unrolled
from sphere_nav.geometry import SE3

MAX_PASSES = 3

TRUTH = np.array([0.3, 0.0, 0.1, 0.0, 0.2, 0.5])  # per second
SHARE = 0.4  # of an error of the velocity comes back as an error of the pose
PERIOD_NS = 100_000_000


def aligned(start, is_converged=True):
    """Align a sphere that a wrong velocity bends; return the velocities it was bent by."""
    prior, used = DriveMotion(), []
    prior.update(Placed(0, SE3.exp(-0.1 * start)))
    prior.update(Placed(PERIOD_NS, SE3.identity()))

    def align(current):
        used.append(current.sphere)
        T = SE3.exp((TRUTH + SHARE * (current.sphere - TRUTH)) * 0.1)
        return SimpleNamespace(is_converged=is_converged, T_world_camera=T)

    align_unrolled(lambda velocity: velocity, 2 * PERIOD_NS, prior, align)
    return used


def test_each_pass_takes_part_of_the_error_away():
    used = aligned(np.zeros(6))
    errors = [np.linalg.norm(velocity - TRUTH) for velocity in used]
    assert len(used) == MAX_PASSES
    assert np.all(np.diff(errors) < 0)
    assert np.isclose(errors[-1] / errors[0], SHARE ** (MAX_PASSES - 1))
