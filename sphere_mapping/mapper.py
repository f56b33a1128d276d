"""READ FIRST. Spheres one after the other -> a graph of key spheres (M15 sections 3.4 and 3.5).

For each sphere: predict where it is, align it with the newest key spheres, keep it as the next key sphere if the
reference no longer explains it, and report. The sphere itself is kept as observed: nothing is fused into it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from photometric import Alignment
from sphere_geometry import SE3
from sphere_map.graph import KeySphere, SphereGraph
from sphere_map.sphere import Sphere
from sphere_mapping.graph import keyframes
from sphere_mapping.graph.keyframes import why_key_sphere
from sphere_mapping.graph.loop_closure import close_loops
from sphere_mapping.graph.motion import MotionPrior, Placed
from sphere_mapping.graph.progress import MapUpdate, Track
from sphere_mapping.graph.registration import PreparedSphere, align, edge_between, turned
from sphere_mapping.graph.unrolling import Unroll, align_unrolled
from sphere_mapping.params import MapperParams


class Mapper:
    """Builds `graph` and `tracks` from spheres; `T_map_first` is the pose of the first one, the origin of the map."""

    def __init__(self, params: MapperParams | None = None, T_map_first: SE3 | None = None) -> None:
        self.params = params or MapperParams()
        self.graph = SphereGraph()
        self.tracks: list[Track] = []
        self._T_map_first = T_map_first or SE3.identity()
        self._prior = MotionPrior()
        self._last: PreparedSphere | None = None
        self._bent: Unroll | None = None  # the first sphere, until it is known how the camera moved
        self._last_alignment: Alignment | None = None
        self._references: list[tuple[int, PreparedSphere]] = []  # the newest first

    def add(self, sphere: Sphere, odometry: SE3 | None = None, unroll: Unroll | None = None) -> MapUpdate:
        """Place one sphere; `odometry` is its pose T_odom_sphere where a vehicle offers one.

        `unroll` makes the sphere of a rolling shutter anew by the camera's velocity.
        """
        current = PreparedSphere(sphere, self.params.registration)
        if self._last is None:
            self._bent = unroll
            return self._place(current, self._T_map_first, odometry, None, keyframes.FIRST)

        current, alignment = self._align_moving(current, odometry, unroll)
        if not alignment.is_converged and self._keep_last():
            current, alignment = self._align_moving(current, odometry, unroll)
        if not alignment.is_converged:
            return MapUpdate(sphere.stamp_ns, None, alignment)

        return self._place(current, alignment.T_world_camera, odometry, alignment, self._why_key(alignment))

    def keep_end(self) -> bool:
        """Keep the last sphere, too, where the newest key sphere is half its reach away; return whether it was kept.

        To be called at the end of a drive: beyond its last key sphere a map does not know the way.
        """
        if not self._references:
            return False
        key_id, reference = self._references[0]
        distance, _ = self.graph[key_id].T_map_sphere.distance(self._prior.newest)
        return bool(distance > 0.5 * keyframes.reach(reference, self.params.key)) and self._keep_last()

    def close_loops(self) -> int:
        """Find places seen twice, verify them by alignment, correct the graph; return how many were found."""
        found = close_loops(self.graph, self.params)
        if found.num_loops and self._references:
            newest = self._references[0][0]
            T_map_before = self.graph[newest].T_map_sphere @ found.graph[newest].T_map_sphere.inverse()
            self._prior.move(T_map_before.inverse())
            self.graph = found.graph
        return found.num_loops

    def trajectory(self) -> Iterator[tuple[int, SE3]]:
        """Yield stamp and T_map_sphere of every placed sphere, in order, as the graph now has it."""
        for track in self.tracks:
            yield track.stamp_ns, self.graph[track.key_id].T_map_sphere @ track.T_key_sphere

    def _align_moving(
        self, current: PreparedSphere, odometry: SE3 | None, unroll: Unroll | None
    ) -> tuple[PreparedSphere, Alignment]:
        if unroll is None:
            return current, self._align(current, odometry)
        if self._bent is not None:
            self._straighten_first(current, odometry, self._bent)
        params = self.params.registration
        return align_unrolled(
            unroll, current.sphere.stamp_ns, self._prior, params, lambda made: self._align(made, odometry)
        )

    def _straighten_first(self, current: PreparedSphere, odometry: SE3 | None, bent: Unroll) -> None:
        """Make the first sphere anew by its motion to the second: as long as both are bent alike, it shows rightly."""
        alignment = self._align(current, odometry)
        if alignment.is_converged:
            first = bent(self._prior.velocity_to(alignment.T_world_camera, current.sphere.stamp_ns))
            self.graph = SphereGraph([replace(self.graph[0], sphere=first)])
            self._last, self._bent = PreparedSphere(first, self.params.registration), None
            self._references = [(0, self._last)]

    def _align(self, current: PreparedSphere, odometry: SE3 | None) -> Alignment:
        references = [prepared.at(self.graph[key_id].T_map_sphere) for key_id, prepared in self._references]
        return align(current, references, self._guesses(current, odometry), self.params.registration)

    def _guesses(self, current: PreparedSphere, odometry: SE3 | None) -> Iterator[SE3]:
        """Yield where the sphere may be: by its motion, by the turn of its image (eq. 20), where the last one was."""
        yield self._prior.predict(current.sphere.stamp_ns, odometry)
        assert self._last is not None
        yield turned(current, self._last, self._prior.newest, self.params.registration)
        yield self._prior.newest

    def _why_key(self, alignment: Alignment) -> str:
        key_id, reference = self._references[0]
        T_reference_sphere = self.graph[key_id].T_map_sphere.inverse() @ alignment.T_world_camera
        return why_key_sphere(alignment, T_reference_sphere, reference, self.params.key)

    def _place(
        self, current: PreparedSphere, T_map_sphere: SE3, odometry: SE3 | None, alignment: Alignment | None, reason: str
    ) -> MapUpdate:
        """Take note of where a sphere is, and keep it as key sphere if there is a reason."""
        stamp_ns = current.sphere.stamp_ns
        self._prior.put(Placed(stamp_ns, T_map_sphere, odometry))
        self._last, self._last_alignment = current, alignment
        if reason != keyframes.NOT_YET:
            self._keep(current, T_map_sphere, alignment)
        key_id = self._references[0][0]
        self.tracks.append(Track(stamp_ns, key_id, self.graph[key_id].T_map_sphere.inverse() @ T_map_sphere))
        return MapUpdate(stamp_ns, T_map_sphere, alignment, reason)

    def _keep_last(self) -> bool:
        """Make the last placed sphere a key sphere, nearer to what follows; return whether it was not one already."""
        if self._last is None or self._references[0][1] is self._last:
            return False
        self._keep(self._last, self._prior.newest, self._last_alignment)
        return True

    def _keep(self, current: PreparedSphere, T_map_sphere: SE3, alignment: Alignment | None) -> None:
        """Add a key sphere, joined to the reference that it was aligned with."""
        node = KeySphere(len(self.graph), current.sphere.stamp_ns, T_map_sphere, current.sphere)
        self.graph.add(node)
        if alignment is not None:
            self.graph.connect(edge_between(self.graph[self._references[0][0]], node, alignment))
        self._references = [(node.id, current), *self._references][: self.params.num_references]
