"""What goes into the filter for one image, and what comes out: the belief in a few words, clusters of particles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from mcl_depth.belief.motion_model import wrap_angle
from mcl_depth.belief.particles import Particles
from mcl_depth.constants import CLUSTER, KLD_BIN, MAX_HYPOTHESES, UNMODELED
from mcl_depth.likeness.depth_map import Comparison
from sphere_nav.geometry import SE3, Camera, so3
from sphere_nav.geometry.arrays import PLANAR, Array
from sphere_nav.localization.status import Status


@dataclass(frozen=True)
class Observation:
    """One image. Frame `level`: the camera's centre with the vehicle's axes, levelled: z up, x where it heads.

    `rotation` (3, 3) turns camera axes into those of `level`; `odometry` is its x, y, yaw (3,) at the stamp, or None.
    """

    image: NDArray[Any]  # grey (H, W)
    camera: Camera
    stamp_ns: int
    rotation: Array
    odometry: Array | None = None


@dataclass(frozen=True)
class Hypothesis:
    """One place: x, y, yaw (3,) in the map, covariance (3, 3) in the map's axes, share of the belief."""

    pose: Array
    covariance: Array
    weight: float

    @property
    def sigma_m(self) -> float:
        """Standard deviation of the position, the larger axis."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[:2, :2])[-1]))

    @property
    def sigma_rad(self) -> float:
        """Standard deviation of the heading."""
        return float(np.sqrt(self.covariance[2, 2]))


@dataclass(frozen=True)
class Belief:
    """What was found out with one image, for whoever wants to look at it."""

    best: Hypothesis  # the likeliest place
    particles: Particles  # weighted, before resampling
    comparison: Comparison
    places: tuple[Hypothesis, ...]  # likely ones, the best first; by the evidence of all images while none is held


@dataclass(frozen=True)
class Estimate:
    """The news of one image; without a trusted pose there is none, without a comparison there is no belief."""

    status: Status
    T_map_level: SE3 | None = None
    covariance: Array | None = None  # (6, 6) of xi = (v, omega) in T_map_level @ exp(xi)
    belief: Belief | None = None


def level_pose(pose: Array, height: float) -> SE3:
    """Return T_map_level from x, y, yaw and the height of the camera in the map."""
    return SE3.from_parts(so3.exp([0.0, 0.0, pose[2]]), [*pose[:2], height])


def pose_covariance(covariance: Array, yaw: float) -> Array:
    """Return the local covariance (6, 6) from that of x, y, yaw (3, 3) in the map's axes, with what particles omit."""
    R = so3.exp([0.0, 0.0, -yaw])
    local = R @ covariance @ R.T
    full = np.zeros((6, 6))
    full[PLANAR] = local
    return full + np.diag(UNMODELED**2)


def find_hypotheses(particles: Particles) -> list[Hypothesis]:
    """Return the clusters by falling weight: particles in bins of position and heading that touch belong together."""
    labels = _labels(particles.poses)
    shares = np.bincount(labels, particles.weights)
    order = np.argsort(-shares, kind="stable")[:MAX_HYPOTHESES]
    return [_hypothesis(particles, np.flatnonzero(labels == label)) for label in order]


def _labels(poses: Array) -> NDArray[np.int64]:
    """Return the number (N,) of the cluster of each pose (N, 3)."""
    box = CLUSTER * KLD_BIN
    num_turns = round(2.0 * np.pi / box[2])
    cells = np.floor(poses / box).astype(np.int64)
    cells[:, 2] %= num_turns
    bins, bin_of = np.unique(cells, axis=0, return_inverse=True)
    around = cKDTree(bins, boxsize=[0.0, 0.0, num_turns])  # headings wrap around
    rows, columns = around.query_pairs(1.5, np.inf, output_type="ndarray").T
    links = coo_array((np.ones(len(rows)), (rows, columns)), shape=(len(bins), len(bins)))
    return connected_components(links, directed=False)[1][bin_of.ravel()].astype(np.int64)


def _hypothesis(particles: Particles, members: NDArray[np.int64]) -> Hypothesis:
    poses, weights = particles.poses[members], particles.weights[members]
    total = float(weights.sum())
    share = weights / total if total > 0.0 else np.full(len(members), 1.0 / len(members))
    yaw = np.arctan2(share @ np.sin(poses[:, 2]), share @ np.cos(poses[:, 2]))
    pose = np.array([*(share @ poses[:, :2]), yaw])
    errors = poses - pose
    errors[:, 2] = wrap_angle(errors[:, 2])
    return Hypothesis(pose, (errors * share[:, None]).T @ errors, total)
