import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.offline.mapping.survey import check_survey
from sphere_nav.ros.bags import BagError
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph

SIGMA = np.repeat([0.004, 0.001], 3)
NUM = 12


def graphs(rng, jumps=()):
    """A chain of key spheres with measured edges, and its survey, wrong from some key spheres on."""
    true = [SE3.from_planar(0.5 * k, 0.1 * k, 0.2 * k) for k in range(NUM)]
    edges = []
    for k in range(NUM - 1):
        T = true[k].inverse() @ true[k + 1] @ SE3.exp(rng.normal(size=6) * SIGMA)
        edges.append(Edge(k, k + 1, T, np.diag(1 / SIGMA**2)))
    aligned = SphereGraph([KeySphere(k, k, T) for k, T in enumerate(true)], edges)
    poses, T_jump = {}, SE3.identity()
    for k, T in enumerate(true):
        if k in jumps:
            T_jump = T_jump @ SE3.exp([0.06, 0.0, 0.0, 0.0, 0.03, 0.0])
        poses[k] = T @ T_jump
    return aligned, aligned.with_poses(poses)


@pytest.mark.parametrize("seed", range(5))
def test_a_survey_that_agrees_passes_in_silence(seed):
    assert check_survey(*graphs(np.random.default_rng(seed)), "drive") == []


def test_a_jump_in_the_survey_is_named():
    [warning] = check_survey(*graphs(np.random.default_rng(1), jumps=(5,)), "drive")
    assert warning.startswith("warning: 1 of 11 motions")
    assert "4 to 5 by" in warning


def test_a_survey_that_most_edges_contradict_is_refused():
    with pytest.raises(BagError, match="drive: expected surveyed poses that agree with the images, found 11 of 11"):
        check_survey(*graphs(np.random.default_rng(1), jumps=range(1, NUM)), "drive")
