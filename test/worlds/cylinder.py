"""A drive around a cylinder whose circles are joined: a pose graph with truth, easy or hopeless by its noise."""

import numpy as np

from sphere_mapping.graph.pose_graph import PoseGraph
from sphere_nav.geometry import SE3


def cylinder(num_circles, num_places, sigmas, seed=0):
    """Return the true poses and a graph that starts at chained odometry; sigmas: m and rad of every axis."""
    rng = np.random.default_rng(seed)
    count = num_circles * num_places
    step = SE3.exp([1.0, 0.0, 0.05, 0.0, 0.0, 2 * np.pi / num_places])
    truth = [np.eye(4)]
    for _ in range(count - 1):
        truth.append(truth[-1] @ step.matrix)
    truth = SE3(np.array(truth))
    ends = [(k, k + 1) for k in range(count - 1)] + [(k, k + num_places) for k in range(count - num_places)]
    a, b = np.array(ends).T
    spread = np.repeat(sigmas, 3)
    motions = (truth[a].inverse() @ truth[b] @ SE3.exp(spread * rng.normal(size=(len(ends), 6)))).matrix
    poses = [np.eye(4)]
    for k in range(count - 1):
        poses.append(poses[-1] @ motions[k])
    poses, information = np.array(poses), np.diag(np.repeat(np.asarray(sigmas, float) ** -2, 3))
    every = np.broadcast_to(information, (len(ends), *information.shape))
    graph = PoseGraph(np.arange(count), poses, np.array(ends), motions, every, np.zeros(len(ends), bool))
    return truth.matrix, graph
