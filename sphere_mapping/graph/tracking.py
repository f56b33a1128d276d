"""Each sphere against the newest key spheres, and whether the result may be believed (M15 section 3.5)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sphere_mapping.graph.both_ways import confirm
from sphere_mapping.graph.motion import Expectation, MotionPrior, Placed
from sphere_mapping.graph.registration import PreparedSphere, align, turned
from sphere_mapping.graph.unrolling import Unroll, align_unrolled
from sphere_mapping.params import MapperParams
from sphere_nav.estimation.normal_equations import symmetric_inverse
from sphere_nav.geometry import SE3
from sphere_nav.photometric import Alignment
from sphere_nav.photometric.align.alignment import GOOD
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph

INNOVATION, ONE_WAY = "INNOVATION", "ONE_WAY"  # refused: not where it can be; the way back does not agree
UNCONFIRMED_M, UNCONFIRMED_SHARE, UNCONFIRMED_RAD = 0.03, 0.03, 0.01  # deviations of an edge that only one way measured


class Tracker:
    """The newest key spheres, the last sphere and its motion."""

    def __init__(self, params: MapperParams) -> None:
        self._params = params
        self.prior = MotionPrior()
        self.last: PreparedSphere | None = None
        self.references: list[tuple[int, PreparedSphere]] = []  # the newest first
        self._last_alignment: Alignment | None = None

    def align(self, current: PreparedSphere, odometry: SE3 | None, graph: SphereGraph) -> Alignment:
        """Align a sphere with the newest key spheres; a result that is not expected, or one-sided, is refused."""
        references = [prepared.at(graph[key_id].T_map_sphere) for key_id, prepared in self.references]
        expected = self.prior.expect(current.sphere.stamp_ns, odometry)

        def doubt(alignment: Alignment) -> str:
            return self._doubt(current, alignment, expected, graph)

        return align(current, references, self._guesses(current, expected), self._params.registration, doubt)

    def align_moving(
        self, current: PreparedSphere, odometry: SE3 | None, unroll: Unroll | None, graph: SphereGraph
    ) -> tuple[PreparedSphere, Alignment]:
        """Return a sphere, straightened by its motion if it is of a rolling shutter, and its alignment."""
        if unroll is None:
            return current, self.align(current, odometry, graph)
        stamp_ns, params = current.sphere.stamp_ns, self._params.registration
        return align_unrolled(unroll, stamp_ns, self.prior, params, lambda made: self.align(made, odometry, graph))

    def replace_last(self, straight: PreparedSphere) -> None:
        """Put another picture in the place of the last sphere, the only reference."""
        self.last, self.references = straight, [(self.references[0][0], straight)]

    def put(
        self, current: PreparedSphere, T_map_sphere: SE3, odometry: SE3 | None, alignment: Alignment | None
    ) -> None:
        """Take note of where a sphere is."""
        self.prior.put(Placed(current.sphere.stamp_ns, T_map_sphere, odometry))
        self.last, self._last_alignment = current, alignment

    def refer_to(self, key_id: int) -> None:
        """Let the last sphere, which became a key sphere, be the newest reference."""
        assert self.last is not None
        self.references = [(key_id, self.last), *self.references][: self._params.num_references]

    def edge_to(self, node: KeySphere, graph: SphereGraph) -> Edge | None:
        """Return the edge from the newest reference to the last sphere, measured both ways; None for the first."""
        if self._last_alignment is None or self.last is None:
            return None
        key_id, reference = self.references[0]
        forward = local(self._last_alignment, graph[key_id])
        motion = confirm(reference, self.last, forward, self._params.registration)
        if motion is not None:
            return motion.edge(key_id, node.id, is_loop=False)
        sigma_m = UNCONFIRMED_M + UNCONFIRMED_SHARE * float(np.linalg.norm(forward.T_world_camera.translation))
        spread = np.diag(np.repeat([sigma_m, UNCONFIRMED_RAD], 3) ** 2)
        return Edge(key_id, node.id, forward.T_world_camera, symmetric_inverse(forward.covariance + spread))

    def _guesses(self, current: PreparedSphere, expected: Expectation) -> Iterator[SE3]:
        """Yield where the sphere may be: by its motion, by the turn of its image (eq. 20), where the last one was."""
        yield expected.T_map_sphere
        if self.last is not None:
            yield turned(current, self.last, self.prior.newest, self._params.registration)
        yield self.prior.newest

    def _doubt(self, current: PreparedSphere, alignment: Alignment, expected: Expectation, graph: SphereGraph) -> str:
        """Return why an alignment is not believed; where nothing sharp was expected, the way back is asked."""
        if not expected.allows(alignment.T_world_camera):
            return INNOVATION
        if expected.is_sharp or not current.sphere.measured.any():  # without range there is no way back
            return GOOD
        key_id, reference = self.references[0]
        motion = confirm(reference, current, local(alignment, graph[key_id]), self._params.registration)
        return GOOD if motion is not None else ONE_WAY


def local(alignment: Alignment, node: KeySphere) -> Alignment:
    """Return an alignment in the map with its pose in the frame of a key sphere."""
    return replace(alignment, T_world_camera=node.T_map_sphere.inverse() @ alignment.T_world_camera)
