"""READ FIRST. Spheres one after the other -> a graph of key spheres (M15 sections 3.4 and 3.5).

For each sphere: predict where it is, align it with the newest key spheres, doubt the result, keep the sphere as the
next key sphere if the reference no longer explains it, look whether the place was seen before, and report. The sphere
itself is kept as observed: nothing is fused into it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from sphere_mapping.graph import keyframes
from sphere_mapping.graph.incremental import IncrementalOptimum
from sphere_mapping.graph.keyframes import MapUpdate, Track
from sphere_mapping.graph.loop_closure import LoopCloser, with_loops
from sphere_mapping.graph.registration import PreparedSphere
from sphere_mapping.graph.store import Pictures, SphereStore
from sphere_mapping.graph.tracking import Tracker
from sphere_mapping.graph.unrolling import Unroll
from sphere_mapping.graph.verification import Run
from sphere_mapping.params import MapperParams
from sphere_nav.geometry import SE3
from sphere_nav.photometric import Alignment
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere


class Mapper:
    """Builds `graph` and `tracks` from spheres; the first one is at `T_map_first` and has the id `first_id`."""

    def __init__(
        self, params: MapperParams | None = None, T_map_first: SE3 | None = None, store: SphereStore | None = None
    ) -> None:
        self.params = params or MapperParams()
        self.graph = SphereGraph()
        self.tracks: list[Track] = []
        self.num_loops, self.first_id = 0, 0
        self._T_map_first = T_map_first or SE3.identity()
        self._tracker, self._pictures = Tracker(self.params), Pictures(store)
        self._bent: Unroll | None = None  # the first sphere, until it is known how the camera moved
        self._loops, self._optimum = LoopCloser(self.params, self.load_sphere), IncrementalOptimum()

    @property
    def appearance(self) -> AppearanceIndex:
        """What the key spheres look like."""
        return self._loops.index

    def add(self, sphere: Sphere, odometry: SE3 | None = None, unroll: Unroll | None = None) -> MapUpdate:
        """Place one sphere; `odometry` is its pose T_odom_sphere where a vehicle offers one.

        `unroll` makes the sphere of a rolling shutter anew by the camera's velocity.
        """
        current = PreparedSphere(sphere, self.params.registration)
        if self._tracker.last is None:
            self._bent = unroll
            return self._place(current, self._T_map_first, odometry, None, keyframes.FIRST)
        if unroll is not None and self._bent is not None:
            self._straighten_first(current, odometry, self._bent)
        current, alignment = self._tracker.align_moving(current, odometry, unroll, self.graph)
        if not alignment.is_converged and self._keep_last():
            current, alignment = self._tracker.align_moving(current, odometry, unroll, self.graph)
        if not alignment.is_converged:
            return MapUpdate(sphere.stamp_ns, None, alignment)
        return self._place(current, alignment.T_world_camera, odometry, alignment, self._why_key(alignment))

    def keep_end(self) -> bool:
        """Keep the last sphere, too, where the newest key sphere is half its reach away; return whether it was kept.

        To be called at the end of a drive: beyond its last key sphere a map does not know the way.
        """
        if self._tracker.last is None:
            return False
        self._bent = None  # a first sphere that nothing followed stays as it is
        self._pictures.settle(self.graph)
        key_id, reference = self._tracker.references[0]
        distance, _ = self.graph[key_id].T_map_sphere.distance(self._tracker.prior.newest)
        return bool(distance > 0.5 * keyframes.reach(reference, self.params.key)) and self._keep_last()

    def close_loops(self, run: Run = map) -> int:
        """Find all places seen twice, verify them by alignment, correct the graph; return how many were found."""
        loops = self._loops.close(self.graph, run)
        if loops or self._optimum.is_used:
            self._correct(with_loops(self.graph, loops))
            self._optimum = IncrementalOptimum()
        return len(loops)

    def trajectory(self) -> Iterator[tuple[int, SE3]]:
        """Yield stamp and T_map_sphere of every placed sphere, in order, as the graph now has it."""
        for track in self.tracks:
            yield track.stamp_ns, self.graph[track.key_id].T_map_sphere @ track.T_key_sphere

    def load_sphere(self, sphere_id: int) -> Sphere:
        """Return the picture of a key sphere; ValueError or OSError where it cannot be read."""
        return self._pictures.load(self.graph[sphere_id])

    def _straighten_first(self, current: PreparedSphere, odometry: SE3 | None, bent: Unroll) -> None:
        """Make the first sphere anew by its motion to the second: as long as both are bent alike, it shows rightly."""
        alignment = self._tracker.align(current, odometry, self.graph)
        if alignment.is_converged:
            first = bent(self._tracker.prior.velocity_to(alignment.T_world_camera, current.sphere.stamp_ns))
            self.graph = SphereGraph([replace(self.graph[self.first_id], sphere=first)])
            self._tracker.replace_last(PreparedSphere(first, self.params.registration))
            self._bent = None

    def _why_key(self, alignment: Alignment) -> str:
        key_id, reference = self._tracker.references[0]
        T_reference_sphere = self.graph[key_id].T_map_sphere.inverse() @ alignment.T_world_camera
        return keyframes.why_key_sphere(alignment, T_reference_sphere, reference, self.params.key)

    def _place(
        self, current: PreparedSphere, T_map_sphere: SE3, odometry: SE3 | None, alignment: Alignment | None, reason: str
    ) -> MapUpdate:
        """Take note of where a sphere is, and keep it as key sphere if there is a reason."""
        self._tracker.put(current, T_map_sphere, odometry, alignment)
        if reason != keyframes.NOT_YET:
            self._keep()
        key_id, newest = self._tracker.references[0][0], self._tracker.prior.newest
        self.tracks.append(Track(current.sphere.stamp_ns, key_id, self.graph[key_id].T_map_sphere.inverse() @ newest))
        return MapUpdate(current.sphere.stamp_ns, newest, alignment, reason)

    def _keep_last(self) -> bool:
        """Make the last placed sphere a key sphere, nearer to what follows; return whether it was not one already."""
        if self._tracker.last is None or self._tracker.references[0][1] is self._tracker.last:
            return False
        self._keep()
        return True

    def _keep(self) -> None:
        """Add the last sphere as key sphere, joined to its reference and to where the place was seen before."""
        current, node_id = self._tracker.last, self.first_id + len(self.graph)
        assert current is not None
        node = KeySphere(node_id, current.sphere.stamp_ns, self._tracker.prior.newest, current.sphere, current.region_m)
        self.graph.add(node)
        edge = self._tracker.edge_to(node, self.graph)
        if edge is not None:
            self.graph.connect(edge)
        self._tracker.refer_to(node_id)
        if self.params.loop.automatic and (loop := self._loops.look(self.graph, current, node_id)):
            self._correct(self._optimum.with_loop(self.graph, loop))
        if self._bent is None:
            self._pictures.settle(self.graph)

    def _correct(self, corrected: SphereGraph) -> None:
        """Take the graph with more loops, where everything is where all edges fit best."""
        newest, before, self.graph = self._tracker.references[0][0], self.graph, corrected
        self._tracker.prior.move(self.graph[newest].T_map_sphere @ before[newest].T_map_sphere.inverse())
        self.num_loops += len(corrected.edges) - len(before.edges)
        self._pictures.correct(self.graph)
