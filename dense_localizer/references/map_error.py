"""How wrong the map is around the camera, by evidence: what its edges admit, and how its key spheres disagree.

The residuals of one alignment cannot show an error that all pixels of a key sphere share: of its range, of its pose. A
second key sphere can. Now and then the image is aligned to one reference alone; the distance from the pose by both
observes their errors.

An edge that one way alone has measured is wide. Where both its ends are known by other edges, the motion between them
is as sure as those make it: of the key spheres around one the information of all edges is added up and inverted. The
errors of edges add up along the graph: what is told is how far a key sphere is off all of them, not the next one alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from dense_localizer.constants import (
    EDGE_HOPS,
    IMAGE_FORGETTING,
    MAP_ERROR_RATIOS,
    MAX_OBSERVED_SIGMAS,
    MIN_EDGE_M,
    REFUSED_FADING,
    SHARED_ERROR,
)
from dense_localizer.params import CovarianceParams
from sphere_nav.estimation.least_squares import gate, symmetric_inverse
from sphere_nav.geometry import SE3, FrameMotion
from sphere_nav.geometry.arrays import Array
from sphere_nav.photometric import Alignment, RegistrationParams
from sphere_nav.photometric.align.esm import register_rig
from sphere_nav.photometric.align.problem import RigImage
from sphere_nav.photometric.params import between
from sphere_nav.spheres.graph import Edge, SphereGraph

# How likely each variance is before anything has been compared: all sizes alike up to the assumed one, larger ones
# less. Their mean is the assumed one.
_PRIOR = np.minimum(1.0, 1.0 / MAP_ERROR_RATIOS)
_PRIOR /= _PRIOR.sum()
_RATIOS = MAP_ERROR_RATIOS / (_PRIOR @ MAP_ERROR_RATIOS)


class MapError:
    """What is known of one map's errors."""

    def __init__(self, graph: SphereGraph, params: CovarianceParams) -> None:
        self._assumed: Array = np.repeat([params.map_sigma_m, params.map_sigma_rad], 3) ** 2
        self._possible = self._assumed[:, None] * _RATIOS
        self._log = np.zeros_like(self._possible)  # likelihood of each by the observations
        self._variance = self._assumed  # by all that is known
        self._edges = EdgeErrors(graph)
        self._count = 0

    def covariance(self, sphere_id: int, T_sphere_camera: SE3) -> Array:
        """Return the covariance (6, 6) of xi in T_map_camera exp(xi) by the map, seen from a key sphere."""
        observed = np.diag(SHARED_ERROR * self._variance)
        edge = self._edges.covariance(sphere_id)
        if edge is None:
            return observed
        R = np.kron(np.eye(2), T_sphere_camera.rotation)
        return observed + SHARED_ERROR * R.T @ edge @ R

    def observe(
        self,
        images: Sequence[RigImage],
        both: Alignment,
        params: RegistrationParams,
        motion: FrameMotion | None = None,
    ) -> None:
        """Place images by one of two references alone, each in turn; `both` is the alignment with the two."""
        if max(len(image.views) for image in images) < 2:
            return
        self._count += 1
        one = [replace(image, views=(image.views[self._count % len(image.views)],)) for image in images]
        alone = register_rig(one, both.T_world_camera, refine_only(params), motion)
        if alone.is_converged:
            xi = (both.T_world_camera.inverse() @ alone.T_world_camera).log()
            self.add(xi, np.diagonal(both.covariance))

    def add(self, xi: Array, noise: Array) -> None:
        """Add an observed disagreement (6,) to which the noise of the image adds a variance (6,) anyway.

        What is kept is how likely each variance is, not a mean of squares less the noise: much noise tells nothing of
        the map, and by chance such a mean is negative, as if an image could be surer than its noise.
        """
        square = np.minimum(xi**2, MAX_OBSERVED_SIGMAS**2 * (np.maximum(self._variance, self._assumed) + noise))
        expected = np.maximum(self._possible + noise[:, None], 1e-30)
        self._log = IMAGE_FORGETTING * self._log - 0.5 * (np.log(expected) + square[:, None] / expected)
        self._variance = self._mean()

    def fade(self) -> None:
        """Return a little to what was assumed: while images are refused none can tell that the map is better.

        Without it a map that was once thought too wrong would refuse every image from then on.
        """
        self._log = REFUSED_FADING * self._log
        self._variance = self._mean()

    def _mean(self) -> Array:
        """Return the mean variance (6,) of each axis."""
        weight = _PRIOR * np.exp(self._log - self._log.max(axis=1, keepdims=True))
        return np.asarray(np.sum(weight * self._possible, axis=1) / weight.sum(axis=1), np.float64)


@cache
def refine_only(params: RegistrationParams) -> RegistrationParams:
    """Return the parameters of an alignment with one of two references that begins where both ended."""
    both = between(params, coarsest=params.pyramid.finest + 1)
    return replace(both, max_pixels=params.max_pixels // 2)


class EdgeErrors:
    """How sure the place of each key sphere is among those around it; made when it is first asked for."""

    def __init__(self, graph: SphereGraph) -> None:
        self._graph, self.covariance = graph, cache(self._average)
        self._edges: dict[int, list[Edge]] = {}
        for edge in graph.edges:
            for end in (edge.a, edge.b):
                self._edges.setdefault(end, []).append(edge)

    def _average(self, sphere_id: int) -> Array | None:
        """Return the mean covariance (6, 6) of the motions to the key spheres around one, its own axes.

        One that another drive added later says how sure that one is: the map stayed where it was. None where there is
        no other.
        """
        if sphere_id not in self._edges:
            return None
        own, motions = self._graph[sphere_id], relative_covariances(self._graph, self._edges, sphere_id)
        found = []
        for other in (self._graph[node] for node in motions):
            if other.id < sphere_id or other.experience == own.experience:
                R = np.kron(np.eye(2), own.T_map_sphere.rotation.T @ other.T_map_sphere.rotation)
                found.append(R @ motions[other.id] @ R.T)
        return np.mean(found, axis=0) if found else None


def relative_covariances(graph: SphereGraph, edges_of: dict[int, list[Edge]], sphere_id: int) -> dict[int, Array]:
    """Return by id the covariance (6, 6) of x in T_sphere_other exp(x) of those around a key sphere.

    By all edges among those that are reached over `EDGE_HOPS` edges, refuted loops and edges that say nothing left out.
    """
    local = newest = {sphere_id}
    for _ in range(EDGE_HOPS):
        reached = (edge for node in newest for edge in edges_of.get(node, ()) if is_usable(graph, edge))
        newest = {end for edge in reached for end in (edge.a, edge.b)} - local
        local = local | newest
    rows = {node: slice(6 * k, 6 * k + 6) for k, node in enumerate(sorted(local - {sphere_id}))}
    information = np.zeros((6 * len(rows), 6 * len(rows)))
    for node in sorted(local):
        for edge in edges_of.get(node, ()):
            if edge.a != node or edge.b not in local or not is_usable(graph, edge):
                continue
            ends = {edge.a: -edge.T_a_b.inverse().adjoint(), edge.b: np.eye(6)}  # of xi, by each end
            for one, J in ends.items():
                for other, K in ends.items():
                    if sphere_id not in (one, other):
                        information[rows[one], rows[other]] += J.T @ edge.information @ K
    covariance = symmetric_inverse(information)
    return {node: covariance[at, at] for node, at in rows.items()}


def is_usable(graph: SphereGraph, edge: Edge) -> bool:
    """Say whether an edge fixes a motion; a loop that the map contradicts, by where it has the ends, fixes none."""
    if np.any(np.linalg.eigvalsh(edge.information) <= 0.0):
        return False
    if not edge.is_loop:
        return True
    T_a_b = graph[edge.a].T_map_sphere.inverse() @ graph[edge.b].T_map_sphere
    xi = (edge.T_a_b.inverse() @ T_a_b).log()
    return bool(xi @ edge.information @ xi <= gate(6))


class MapDrift:
    """The covariance (6, 6) of xi in T_start_now @ exp(xi) by the errors of the map between both."""

    def __init__(self, graph: SphereGraph | None = None) -> None:
        self.per_meter = estimate_drift_rate(graph) if graph is not None else np.zeros(6)
        self.reset()

    def reset(self) -> None:
        """Begin anew: nothing has drifted yet."""
        self.covariance: Array = np.zeros((6, 6))
        self._last: SE3 | None = None

    def propagate(self, T_map_now: SE3) -> None:
        """Go on to another pose: what has been wrong turns with the body, and a wrong heading moves what follows."""
        if self._last is not None:
            T_now_before = T_map_now.inverse() @ self._last
            Ad, meters = T_now_before.adjoint(), float(np.linalg.norm(T_now_before.translation))
            self.covariance = Ad @ self.covariance @ Ad.T + np.diag(self.per_meter * meters)
        self._last = T_map_now


def estimate_drift_rate(graph: SphereGraph) -> Array:
    """Return the variance (6,) of a meter of the map, the same along all axes: the median over its edges."""
    rates = []
    for edge in graph.edges:
        try:
            variance = SHARED_ERROR * np.diagonal(np.linalg.inv(edge.information))
        except np.linalg.LinAlgError:
            continue
        a, b = graph[edge.a].T_map_sphere, graph[edge.b].T_map_sphere
        length = max(float(a.distance(b)[0]), MIN_EDGE_M)
        rates.append([variance[:3].mean() / length, variance[3:].mean() / length])
    assumed = CovarianceParams()
    return np.repeat(np.median(rates, axis=0) if rates else np.square([assumed.map_sigma_m, assumed.map_sigma_rad]), 3)
