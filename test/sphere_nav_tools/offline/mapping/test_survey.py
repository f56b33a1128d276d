import numpy as np
import pytest
from scipy.stats import chi2

from sphere_nav.geometry import SE3
from sphere_nav.ros.bags import BagError
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph
from sphere_nav_tools.offline.mapping.drive import check_survey

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


def test_a_survey_that_agrees_passes_in_silence():
    for seed in range(5):
        assert check_survey(*graphs(np.random.default_rng(seed)), "drive") == []


def test_a_jump_in_the_survey_is_named():
    [warning] = check_survey(*graphs(np.random.default_rng(1), jumps=(5,)), "drive")
    assert warning.startswith("warning: 1 of 11 motions")
    assert "4 to 5 by" in warning


def test_a_survey_that_most_edges_contradict_is_refused():
    with pytest.raises(BagError, match="drive: expected surveyed poses that agree with the images, found 11 of 11"):
        check_survey(*graphs(np.random.default_rng(1), jumps=range(1, NUM)), "drive")


def test_a_motion_contradicts_the_survey_once_in_ten_thousand_by_chance():
    """Its deviations count twice, the survey has 1 cm and 0.3 deg of its own; chi2 of six degrees of freedom."""
    for factor, is_named in [(0.99, False), (1.01, True)]:
        for axis in [0, 2, 4]:
            limit = np.sqrt(chi2.isf(1e-4, 6))
            sigma = np.sqrt((2.0 * SIGMA) ** 2 + np.repeat([0.01, np.radians(0.3)], 3) ** 2)
            xi = np.zeros(6)
            xi[axis] = -factor * limit * sigma[axis]
            edges = [Edge(k, k + 1, SE3.identity(), np.diag(1 / SIGMA**2)) for k in range(3)]
            graph = SphereGraph([KeySphere(k, k, SE3.identity()) for k in range(4)], edges)
            off = SE3.exp(xi)
            found = check_survey(
                graph, graph.with_poses({0: off, 1: off, 2: off}), "drive"
            )  # the last motion alone is off
            assert bool(found) == is_named
            if is_named:
                meters, radians = np.linalg.norm(xi[:3]), np.linalg.norm(xi[3:])
                assert f"2 to 3 by {1e3 * meters:.0f} mm, {np.degrees(radians):.2f} deg (5.3 sigma)" in found[0]


@pytest.mark.parametrize(("num_wrong", "is_refused"), [(6, False), (7, True)])
def test_a_survey_is_refused_when_more_than_half_of_the_motions_contradict(num_wrong, is_refused):
    edges = [Edge(k, k + 1, SE3.identity(), 1e6 * np.eye(6)) for k in range(12)]
    graph = SphereGraph([KeySphere(k, k, SE3.identity()) for k in range(13)], edges)
    poses = {k: SE3.from_planar(0.2 * min(k, num_wrong), 0.0, 0.0) for k in range(13)}
    if is_refused:
        with pytest.raises(BagError, match="7 of 12 motions"):
            check_survey(graph, graph.with_poses(poses), "drive")
    else:
        (line,) = check_survey(graph, graph.with_poses(poses), "drive")
        assert line.startswith("warning: 6 of 12 motions between key spheres contradict the survey")
        assert line.count(" to ") == 3  # the worst by name
