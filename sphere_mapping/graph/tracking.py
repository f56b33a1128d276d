"""Each sphere against the newest key spheres: predict, align, check (M15 section 3.5)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from sphere_mapping.constants import CONTRADICTED, NUM_PASSES, STILL, UNCONFIRMED, UNCONFIRMED_SHARE
from sphere_mapping.graph import keyframes
from sphere_mapping.graph.both_ways import confirm, find_motion, measure_motion, measure_motion_by_parts, why_denied
from sphere_mapping.graph.keyframes import Track
from sphere_mapping.graph.loop_closure import LoopCloser
from sphere_mapping.graph.motion import DriveMotion, Expectation, Placed
from sphere_mapping.graph.registration import PreparedSphere, align_sphere, guess_by_rotation, residual_at
from sphere_mapping.params import MapperParams
from sphere_nav.estimation.least_squares import symmetric_inverse
from sphere_nav.geometry import SE3
from sphere_nav.geometry.arrays import Array
from sphere_nav.photometric import Alignment
from sphere_nav.photometric.align.esm import GOOD
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere

Unroll: TypeAlias = Callable[[Array], Sphere]  # velocity (6,) (v, omega) per second of the sphere -> sphere


INNOVATION = "INNOVATION"  # refused: not where it can be


class SphereTracker:
    """The newest key spheres, the last sphere and its motion."""

    def __init__(self, params: MapperParams) -> None:
        self._params = params
        self.motion = DriveMotion()
        self.last: PreparedSphere | None = None
        self.references: list[tuple[int, PreparedSphere]] = []  # the newest first
        self._last_alignment: Alignment | None = None

    def align(self, current: PreparedSphere, odometry: SE3 | None, graph: SphereGraph) -> Alignment:
        """Align a sphere with the newest key spheres; a result that is not expected, or one-sided, is refused.

        A known motion is the first guess. Where none is known, or it does not hold, features find one, or parts of the
        images; where several spheres in a row were not where they were expected, one that is not expected either.
        """
        references = [prepared.at(graph[key_id].T_map_sphere) for key_id, prepared in self.references]
        expected = self.motion.expect(current.sphere.stamp_ns, odometry)

        def align_expected() -> Alignment:
            guesses = self._guesses(current, expected)
            return align_sphere(current, references, guesses, lambda one: self._check(current, one, expected, graph))

        found = align_expected() if expected.is_known else None
        if found is not None and found.is_converged:
            return found

        def is_possible(proven: Alignment) -> bool:
            return self.motion.num_lost >= CONTRADICTED or expected.allows(proven.T_world_camera)

        for key_id, reference in self.references:
            proven = self._prove(current, reference, graph[key_id])
            if proven is not None and is_possible(proven):
                return proven
        found = found or align_expected()
        if found.is_converged:
            return found
        proven = self._prove_by_parts(current, expected, graph)
        return proven if proven is not None and is_possible(proven) else found

    def find_again(self, current: PreparedSphere, found: Alignment, loops: LoopCloser, graph: SphereGraph) -> Alignment:
        """Return an alignment; in place of a refused one, after several, that with a key sphere that looks alike.

        That key sphere is the newest reference then.
        """
        if found.is_converged or self.motion.num_lost < CONTRADICTED:
            return found
        seen, known = loops.recognize(graph, current), [key_id for key_id, _ in self.references]
        if seen is None or seen.older in known:
            return found
        reference = loops.prepare(seen.older)
        proven = self._prove(current, reference, graph[seen.older])
        if proven is None:
            return found
        self.references = [(seen.older, reference), *self.references][: self._params.num_references]
        return proven

    def _prove(self, current: PreparedSphere, reference: PreparedSphere, node: KeySphere) -> Alignment | None:
        """Return the alignment of a sphere with a key sphere from no guess at all; None unless it is proven."""
        motion = find_motion(reference, current)
        if motion is None:
            return None
        T_map_sphere = node.T_map_sphere @ motion.T_a_b
        return replace(motion.forward, T_world_camera=T_map_sphere, covariance=motion.covariance)

    def _prove_by_parts(self, current: PreparedSphere, expected: Expectation, graph: SphereGraph) -> Alignment | None:
        """Return the alignment with the newest key sphere by parts of the images; None unless it is proven."""
        key_id, reference = self.references[0]
        T_map_key = graph[key_id].T_map_sphere
        motion = measure_motion_by_parts(reference, current, T_map_key.inverse() @ expected.T_map_sphere)
        if motion is None:
            return None
        seen = residual_at(current, reference.at(T_map_key), T_map_key @ motion.T_a_b)
        return replace(seen, covariance=motion.covariance, reason=GOOD)

    def align_moving(
        self, current: PreparedSphere, odometry: SE3 | None, unroll: Unroll | None, graph: SphereGraph
    ) -> tuple[PreparedSphere, Alignment]:
        """Return a sphere, straightened by its motion if it is of a rolling shutter, and its alignment."""
        if unroll is None:
            return current, self.align(current, odometry, graph)
        stamp_ns = current.sphere.stamp_ns
        return align_unrolled(unroll, stamp_ns, self.motion, lambda made: self.align(made, odometry, graph))

    def update(
        self, current: PreparedSphere, T_map_sphere: SE3, odometry: SE3 | None, alignment: Alignment | None
    ) -> None:
        """Take down where a sphere is: it is the last one now."""
        self.motion.update(Placed(current.sphere.stamp_ns, T_map_sphere, odometry))
        self.last, self._last_alignment = current, alignment

    def why_key(self, alignment: Alignment, graph: SphereGraph) -> str:
        """Return why an aligned sphere must become the next key sphere, or `keyframes.NOT_YET` (M15 eq. 12)."""
        key_id, reference = self.references[0]
        T_reference_sphere = local(alignment, graph[key_id]).T_world_camera
        return keyframes.why_key_sphere(alignment, T_reference_sphere, reference, self._params.key)

    def make_key(self, key_id: int, graph: SphereGraph) -> tuple[KeySphere, Edge | None]:
        """Make the last sphere the newest reference; return it as key sphere, and its edge to the one before.

        It is where both ways of the edge put it: what one way errs ahead, the other errs back, and all along the drive
        one way alone would add up.
        """
        assert self.last is not None
        sphere, edge = self.last.sphere, self._edge_to(key_id, graph)
        if edge is not None:
            correction = graph[edge.a].T_map_sphere @ edge.T_a_b @ self.motion.newest.inverse()
            self.motion.transform(correction.orthonormal())  # else what rounding leaves would double with each
        self.references = [(key_id, self.last), *self.references][: self._params.num_references]
        return KeySphere(key_id, sphere.stamp_ns, self.motion.newest, sphere, self.last.region_m), edge

    @property
    def is_key(self) -> bool:
        """Whether the last sphere is a key sphere."""
        return bool(self.references) and self.references[0][1] is self.last

    def is_far(self, graph: SphereGraph) -> bool:
        """Say whether the newest key sphere is more than half its reach away from the last sphere."""
        key_id, reference = self.references[0]
        distance, _ = graph[key_id].T_map_sphere.distance(self.motion.newest)
        return bool(distance > 0.5 * keyframes.reach(reference, self._params.key))

    def track(self, graph: SphereGraph) -> Track:
        """Return the last sphere by the newest key sphere."""
        assert self.last is not None
        key_id, _ = self.references[0]
        return Track(self.last.sphere.stamp_ns, key_id, graph[key_id].T_map_sphere.inverse() @ self.motion.newest)

    def follow(self, before: SphereGraph, corrected: SphereGraph) -> None:
        """Move with the newest key sphere, which a correction of the graph has moved."""
        newest = self.references[0][0] if self.references else next(iter(before.nodes))
        self.motion.transform(corrected[newest].T_map_sphere @ before[newest].T_map_sphere.inverse())

    def straighten_newest(
        self,
        current: PreparedSphere,
        odometry: SE3 | None,
        unroll: Unroll | None,
        unroll_newest: Unroll,
        graph: SphereGraph,
    ) -> SphereGraph | None:
        """Unroll the newest key sphere by the motion from the sphere before it to the one after it, measure it anew.

        By the motion that led to it alone it would be half an interval late, and err with its own pose. The first one
        and the second are rolling alike, so that their motion shows rightly. None where the next one is not aligned.
        """
        is_first = len(self.references) == 1 and self.motion.before is None
        _, alignment = self.align_moving(current, odometry, None if is_first else unroll, graph)
        if not alignment.is_converged:
            return None
        if not self.is_key or self.motion.num_lost:
            return graph
        velocity = self.motion.velocity_through(alignment.T_world_camera, current.sphere.stamp_ns)
        return self.replace_newest(unroll_newest(velocity), graph)

    def replace_newest(self, sphere: Sphere, graph: SphereGraph) -> SphereGraph:
        """Put another sphere in place of the last one, the newest key sphere; return the graph with it, measured anew.

        Its edge is the last one that the graph was given. Where nothing confirms it the sphere stays where it was.
        """
        (key_id, _), *older = self.references
        self.last = PreparedSphere(sphere)
        self.references = [(key_id, self.last), *older]
        node, edges = replace(graph[key_id], sphere=sphere, region_radius_m=self.last.region_m), list(graph.edges)
        if older and edges:
            before_id, before = older[0]
            guess = graph[before_id].T_map_sphere.inverse() @ node.T_map_sphere
            motion = measure_motion(before, self.last, guess)
            if motion is not None and (edges[-1].a, edges[-1].b) == (before_id, key_id):
                edges[-1] = motion.edge(before_id, key_id, is_loop=False)
                T_map_sphere = graph[before_id].T_map_sphere @ motion.T_a_b
                self.motion.transform((T_map_sphere @ node.T_map_sphere.inverse()).orthonormal())
                node = replace(node, T_map_sphere=T_map_sphere)
        return SphereGraph([node if one.id == key_id else one for one in graph], edges)

    def _edge_to(self, newer_id: int, graph: SphereGraph) -> Edge | None:
        """Return the edge from the newest reference to the last sphere, measured both ways; None for the first."""
        if self._last_alignment is None or self.last is None:
            return None
        key_id, reference = self.references[0]
        forward = local(self._last_alignment, graph[key_id])
        motion = confirm(reference, self.last, forward) or measure_motion_by_parts(
            reference, self.last, forward.T_world_camera
        )
        if motion is not None:
            return motion.edge(key_id, newer_id, is_loop=False)
        sigma_m = UNCONFIRMED[0] + UNCONFIRMED_SHARE * float(np.linalg.norm(forward.T_world_camera.translation))
        unconfirmed = np.diag(np.repeat([sigma_m, UNCONFIRMED[1]], 3) ** 2)
        return Edge(key_id, newer_id, forward.T_world_camera, symmetric_inverse(forward.covariance + unconfirmed))

    def _guesses(self, current: PreparedSphere, expected: Expectation) -> Iterator[SE3]:
        """Yield where the sphere may be: by its motion, by the turn of its image (eq. 20), where the last one was."""
        yield expected.T_map_sphere
        if self.last is not None:
            yield guess_by_rotation(current, self.last, self.motion.newest)
        yield self.motion.newest

    def _check(self, current: PreparedSphere, alignment: Alignment, expected: Expectation, graph: SphereGraph) -> str:
        """Return why an alignment is not believed; where nothing sharp was expected, the way back is asked.

        Where nothing was expected at all, features are heard, too.
        """
        if not expected.allows(alignment.T_world_camera):
            return INNOVATION
        if expected.is_sharp:
            return GOOD
        key_id, reference = self.references[0]
        forward, is_expected = local(alignment, graph[key_id]), expected.is_known
        return why_denied(reference, current, forward, is_expected=is_expected)


def is_followed(lost: Sphere, current: PreparedSphere) -> bool:
    """Say whether a lost sphere is one to begin with: the next one is aligned with it."""
    return find_motion(PreparedSphere(lost), current) is not None


def local(alignment: Alignment, node: KeySphere) -> Alignment:
    """Return an alignment in the map with its pose in the frame of a key sphere."""
    return replace(alignment, T_world_camera=node.T_map_sphere.inverse() @ alignment.T_world_camera)


def align_unrolled(
    unroll: Unroll,
    stamp_ns: int,
    motion: DriveMotion,
    align: Callable[[PreparedSphere], Alignment],
) -> tuple[PreparedSphere, Alignment]:
    """Align a sphere as warped by the expected motion, and again by the motion that was found, until they agree."""
    velocity = motion.velocity()
    for _ in range(NUM_PASSES):
        current = PreparedSphere(unroll(velocity))
        alignment = align(current)
        if not alignment.is_converged:
            break
        expected, velocity = velocity, motion.velocity_to(alignment.T_world_camera, stamp_ns)
        if np.linalg.norm(velocity - expected) < STILL:
            break
    return current, alignment
