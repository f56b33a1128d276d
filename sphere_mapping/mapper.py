"""READ FIRST. Spheres one after the other -> a graph of key spheres (M15 sections 3.4 and 3.5).

For each sphere: predict where it is, align it with the newest key spheres, check the result, keep the sphere as the
next key sphere if the reference no longer explains it, close a loop where the place was seen before, and report. The
sphere itself is kept as observed: nothing is fused into it.
"""

from __future__ import annotations

from collections.abc import Iterator

from sphere_mapping.graph.incremental import IncrementalOptimum
from sphere_mapping.graph.keyframes import FIRST, NOT_YET, MapUpdate, Track
from sphere_mapping.graph.loop_closure import Kept, LoopCloser
from sphere_mapping.graph.optimum import optimize_map
from sphere_mapping.graph.registration import PreparedSphere
from sphere_mapping.graph.store import SphereCache, SphereStore
from sphere_mapping.graph.tracking import SphereTracker, Unroll, is_followed
from sphere_mapping.graph.verification import Run
from sphere_mapping.params import MapperParams
from sphere_nav.geometry import SE3
from sphere_nav.photometric import Alignment
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.graph import SphereGraph
from sphere_nav.spheres.sphere import Sphere

Given = tuple[Sphere, SE3 | None, Unroll | None]  # what `add` is given


class Mapper:
    """Builds `graph` and `tracks` from spheres; the first is at `T_map_first`, with id `first_id`; why: `origin`."""

    def __init__(
        self,
        params: MapperParams | None = None,
        T_map_first: SE3 | None = None,
        store: SphereStore | None = None,
        features: Kept | None = None,
    ) -> None:
        self.params, self._spheres = params or MapperParams(), SphereCache(store)
        self.num_loops, self.first_id, self._features = 0, 0, features if features is not None else {}
        self.T_map_first, self.origin = T_map_first or SE3.identity(), "the first sphere"
        self.T_base_sphere: SE3 | None = None  # spheres on the vehicle, where that is told
        self._begin()

    def _begin(self) -> None:
        self.graph, self.tracks, self._tracker = SphereGraph(), list[Track](), SphereTracker(self.params)
        self._features.clear()
        self._loops, self._optimum = LoopCloser(self.params, self.load_sphere, self._features), IncrementalOptimum()
        self._unroll_newest: Unroll | None = None  # the newest key sphere, until it is known how the camera moved on
        self._lost: Given | None = None

    def add(self, sphere: Sphere, odometry: SE3 | None = None, unroll: Unroll | None = None) -> MapUpdate:
        """Map one sphere; `odometry` is its T_odom_sphere; `unroll` makes that of a rolling shutter by its velocity."""
        current = PreparedSphere(sphere)
        if self._tracker.last is None:
            return self._update(current, self.T_map_first, odometry, None, FIRST, unroll)
        if self._unroll_newest is not None:
            moves = odometry, unroll, self._unroll_newest
            if (straight := self._tracker.straighten_newest(current, *moves, self.graph)) is not None:
                self.graph = straight
                self._finish_newest()
        current, alignment = self._tracker.align_moving(current, odometry, unroll, self.graph)
        if not alignment.is_converged and self._keep_last():  # what follows is nearer to it
            current, alignment = self._tracker.align_moving(current, odometry, unroll, self.graph)
        alignment = self._tracker.find_again(current, alignment, self._loops, self.graph)
        if not alignment.is_converged:
            if self._lost and len(self.tracks) == 1 and is_followed(self._lost[0], current):
                return self._begin_anew(self._lost, (sphere, odometry, unroll))
            self._lost = sphere, odometry, unroll
            self._tracker.motion.lose()
            return MapUpdate(sphere.stamp_ns, None, alignment)
        reason = self._tracker.why_key(alignment, self.graph)
        return self._update(current, alignment.T_world_camera, odometry, alignment, reason, unroll)

    def keep_end(self) -> bool:
        """Keep the last sphere if the newest key sphere is half its reach away; say whether it was."""
        if self._tracker.last is None:
            return False
        if self._unroll_newest is not None:  # a sphere that nothing followed stays as it is
            self._finish_newest()
        is_kept = self._tracker.is_far(self.graph) and self._keep_last()
        self._spheres.flush(self.graph)
        return is_kept

    def close_loops(self, run: Run = map) -> int:
        """Find all places seen twice, verify them by alignment, correct the graph; return how many were found."""
        loops = self._loops.find_all(self.graph, run)
        if loops or self._optimum.is_used:
            self._correct(optimize_map(self.graph.with_edges(loops)))
            self._optimum = IncrementalOptimum()
        return len(loops)

    def trajectory(self) -> Iterator[tuple[int, SE3]]:
        """Yield stamp and T_map_sphere of every placed sphere, in order, as the graph now has it."""
        for track in self.tracks:
            yield track.stamp_ns, self.graph[track.key_id].T_map_sphere @ track.T_key_sphere

    def load_sphere(self, sphere_id: int) -> Sphere:
        """Return the sphere of a node; ValueError or OSError where it cannot be read."""
        return self._spheres.load(self.graph[sphere_id])

    @property
    def appearance(self) -> AppearanceIndex:
        """What the key spheres look like."""
        return self._loops.index

    def _update(self, current: PreparedSphere, T_map_sphere: SE3, odometry: SE3 | None, alignment: Alignment | None,
                reason: str, unroll: Unroll | None) -> MapUpdate:  # fmt: skip
        """Take down where a sphere is, keep it as key sphere if there is a reason, and report."""
        self._tracker.update(current, T_map_sphere, odometry, alignment)
        if reason != NOT_YET:
            self._keep_last(unroll)
        self.tracks.append(self._tracker.track(self.graph))
        if self._unroll_newest is None and len(self.tracks) > 1:  # before, it may be given up
            self._spheres.flush(self.graph)
        return MapUpdate(current.sphere.stamp_ns, self._tracker.motion.newest, alignment, reason)

    def _begin_anew(self, *spheres: Given) -> MapUpdate:
        """Give up a first sphere that nothing is aligned with (a covered lens): begin with the last lost one."""
        self._begin()
        return [self.add(*one) for one in spheres][-1]

    def _keep_last(self, unroll: Unroll | None = None) -> bool:
        """Make the last sphere the next key sphere, to be unrolled anew; return whether it was not one already."""
        if self._tracker.last is None or self._tracker.is_key:
            return False
        node, edge = self._tracker.make_key(self.first_id + len(self.graph), self.graph)
        self.graph.add(node)
        if edge is not None:
            self.graph.connect(edge)
        if self.tracks and self.tracks[-1].stamp_ns == node.stamp_ns:
            self.tracks[-1] = self._tracker.track(self.graph)
        self._unroll_newest = unroll
        if unroll is None:
            self._finish_newest()
        return True

    def _finish_newest(self) -> None:
        """Close a loop with the newest key sphere, which stays as it is now."""
        self._unroll_newest = None
        newest_id, newest = self._tracker.references[0]
        if self.params.loop.automatic and (loop := self._loops.find(self.graph, newest, newest_id)):
            self._correct(self._optimum.with_loop(self.graph, loop))

    def _correct(self, corrected: SphereGraph) -> None:
        """Go on with the graph with more loops, where everything is where all edges fit best."""
        self._tracker.follow(self.graph, corrected)
        self.num_loops += len(corrected.edges) - len(self.graph.edges)
        self.graph = corrected
