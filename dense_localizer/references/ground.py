"""A vehicle stands on the ground that was taught: its height, roll and pitch are those of the key spheres around it.

That is worth most to a narrow view, in which a step ahead looks like a change of height and pitch, and cars that stand
elsewhere decide between them. How even the ground is say the key spheres themselves. Nothing is expected where nobody
tells how a camera sits on the vehicle, or where a map was taken by hand.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from dense_localizer.constants import GROUND_REACH_M, GROUND_SIGMA, MAX_GROUND_SIGMA_RAD
from dense_localizer.motion_prior import Prediction
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.photometric.align.problem import NO_EXPECTATION, Expectation
from sphere_nav.spheres.graph import SphereGraph

ON_GROUND = [2, 3, 4]  # of a tangent vector of the base: height, roll, pitch


class Ground:
    """The ground of one map. `T_base_body`: the camera, or what several share, on the vehicle; None: nobody knows."""

    def __init__(self, graph: SphereGraph, T_base_sphere: SE3 | None) -> None:
        self.T_base_body: SE3 | None = None
        first = graph[min(graph.nodes)]
        # Later drives have mounts of their own, which nobody tells.
        taught = [node for node in graph if node.experience == first.experience]
        self._taught = SphereGraph(sorted(taught, key=lambda node: node.id))
        self._T_sphere_base = (T_base_sphere or SE3.identity()).inverse()
        # (3,) m, rad; None: no vehicle on a ground, or nobody knows how it carried the spheres.
        self.sigma = self._measure() if T_base_sphere is not None else None

    def stand(self, prediction: Prediction) -> Prediction:
        """Return a prediction with what the ground says of its pose."""
        return replace(prediction, expected=self.expect(prediction.T_map_camera))

    def camera_on_base(self, T_body_camera: SE3 | None) -> SE3 | None:
        """Return where a camera of the body is on the vehicle; None: nobody knows."""
        if self.T_base_body is None or T_body_camera is None:
            return self.T_base_body
        return self.T_base_body @ T_body_camera

    def height_above(self, T_base_camera: SE3) -> float:
        """Return by how much in m a camera is higher than the key spheres; 0 where nobody knows."""
        if self.sigma is None:
            return 0.0
        return float((self._T_sphere_base @ T_base_camera).translation[2])

    def expect(self, T_map_body: SE3, T_body_camera: SE3 | None = None) -> Expectation:
        """Return what the ground says of the body near a pose; or of a camera on it, then the pose is that one's."""
        T_base_body = self.camera_on_base(T_body_camera)
        if T_base_body is None or self.sigma is None:
            return NO_EXPECTATION
        if not (near := self._taught.nearest(T_map_body.translation, 1, GROUND_REACH_M)):
            return NO_EXPECTATION
        T_map_ground, T_map_base = near[0].T_map_sphere @ self._T_sphere_base, T_map_body @ T_base_body.inverse()
        place = T_map_ground.inverse() @ T_map_base
        x, y, _ = place.translation.tolist()
        T_map_expected = T_map_ground @ SE3.from_planar(x, y, float(place.yaw)) @ T_base_body
        A = T_base_body.adjoint()[ON_GROUND]
        return Expectation(T_map_expected, A.T @ np.diag(self.sigma**-2) @ A)

    def _measure(self) -> Array | None:
        """Return how far height, roll and pitch differ between neighbours, but for what is assumed at least."""
        T_map_base = [node.T_map_sphere @ self._T_sphere_base for node in self._taught]
        steps = [a.inverse() @ b for a, b in pairwise(T_map_base) if a.distance(b)[0] <= GROUND_REACH_M]
        differ = np.array([[T.translation[2], *T.angles[:2]] for T in steps]).reshape(-1, 3)
        sigma = np.sqrt(np.mean(differ**2, axis=0)) if steps else np.zeros(3)
        return np.maximum(sigma, GROUND_SIGMA) if max(sigma[1:]) <= MAX_GROUND_SIGMA_RAD else None
