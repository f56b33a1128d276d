"""The maps of a drive's segments, one after the other -> one graph, in the frame of the first one.

Two segments share the instant that the one ends and the other begins with: a key sphere of both. It is one more link of
the chain than a whole drive would have, so the key spheres before and after it are aligned with each other, too. Where
it was lost, the next key spheres are aligned with the last one, or looked up in all that is joined, as one drive is
joined to the map of another.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from sphere_mapping.graph.both_ways import find_motion
from sphere_mapping.graph.extension import Submap, find_joins, place_of_drive
from sphere_mapping.graph.keyframes import Track
from sphere_mapping.graph.optimum import optimize_map
from sphere_mapping.graph.registration import PreparedSphere
from sphere_mapping.graph.verification import LoopTrial, Run, verify
from sphere_mapping.params import MapperParams
from sphere_nav.geometry import SE3
from sphere_nav.ros.maps.compact import CompactFeatures
from sphere_nav.ros.maps.reader import MapReader, open_map
from sphere_nav.ros.maps.writer import Stored
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere
from sphere_nav_tools.offline.constants import MAX_BRIDGED
from sphere_nav_tools.offline.mapping.segment_work import SegmentRecord

NUM_OPEN = 4  # maps of segments whose files are open at once


@dataclass(frozen=True, eq=False)
class SegmentPart:
    """The map of a segment, None where it has no key spheres, and its record."""

    path: Path | None
    record: SegmentRecord


@dataclass(frozen=True, eq=False)
class Bridge:
    """By what segments without a common instant are joined; `run` does the work on many key spheres."""

    params: MapperParams
    run: Run = map


@dataclass(frozen=True, eq=False)
class _Place:
    """Where a segment is: T_joined_part, its key sphere `anchor`, the joined one that it is seen from, edges between.

    T_newest_anchor is the identity where both are the same one.
    """

    T_joined_part: SE3
    anchor: int
    newest: int
    edges: tuple[Edge, ...] = ()


@dataclass(eq=False)
class JoinedSegments:
    """What was joined; `sources`: the map and the id there of every key sphere, by its id."""

    graph: SphereGraph = field(default_factory=SphereGraph)
    tracks: list[Track] = field(default_factory=list)
    index: AppearanceIndex = field(default_factory=lambda: AppearanceIndex(CompactFeatures()))
    sources: dict[int, tuple[Path, int]] = field(default_factory=dict)
    seams: list[tuple[int, int]] = field(default_factory=list)  # key spheres before and after a shared one
    num_lost: int = 0
    _open: dict[Path, MapReader] = field(default_factory=dict)

    def reader(self, path: Path) -> MapReader:
        """Return the map of a segment, open until some others have been."""
        if path not in self._open:
            if len(self._open) == NUM_OPEN:
                self._open.pop(next(iter(self._open))).close()
            self._open[path] = open_map(path)
        return self._open[path]

    def close(self) -> None:
        """Close all files."""
        while self._open:
            self._open.popitem()[1].close()

    def add(self, node: KeySphere, edges: Sequence[Edge], sphere: Sphere) -> None:
        """Refuse: all that is joined is stored."""
        raise ValueError(f"key sphere {node.id}: expected none after the last segment, found one")

    def tell(self, graph: SphereGraph) -> None:
        """Do nothing: the whole graph is written at the end."""

    def load(self, sphere_id: int) -> Sphere:
        """Return a key sphere; BagError where it cannot be read."""
        path, own = self.sources[sphere_id]
        return self.reader(path).load_sphere(own)

    def stored(self) -> Iterator[Stored]:
        """Yield every key sphere as its segment has it, under the id it has now."""
        ids = {source: sphere_id for sphere_id, source in self.sources.items()}
        for path in dict.fromkeys(path for path, _ in ids):
            with open_map(path) as reader:
                for whole, small in reader.stored():
                    if (sphere_id := ids.get((path, int(whole.id)))) is not None:
                        whole.id = small.id = sphere_id
                        yield whole, small


def join_segments(parts: Sequence[SegmentPart], first_id: int = 0, bridge: Bridge | None = None) -> JoinedSegments:
    """Join the maps of segments in their order; one without a place counts as lost."""
    joined = JoinedSegments()
    for part in parts:
        joined.num_lost += part.record.num_lost
        if part.path is None:
            continue
        reader = joined.reader(part.path)
        if not len(joined.graph):
            first = min(reader.graph.nodes)
            place: _Place | None = _Place(SE3.identity(), first, first_id)
        else:
            place = _shared(joined.graph, reader.graph)
            if place is None and bridge is not None:
                place = _bridged(joined, reader, bridge)
        if place is None:
            newest = _newest(joined.graph).stamp_ns
            joined.num_lost += sum(track.stamp_ns > newest for track in part.record.tracks)
        else:
            _take(joined, reader, part.record, place)
    if bridge is not None and joined.seams:
        _span(joined, bridge)
    return joined


def _take(joined: JoinedSegments, reader: MapReader, record: SegmentRecord, place: _Place) -> None:
    """Add what a segment has after the newest key sphere."""
    graph, part = joined.graph, reader.graph
    newest_ns = graph[place.newest].stamp_ns if len(graph) else -1
    is_shared = place.newest in graph.nodes and not place.edges
    fresh = [node for node in part if node.stamp_ns > newest_ns and not (is_shared and node.id == place.anchor)]
    ids = {node.id: max(graph.nodes, default=place.newest - 1) + 1 + k for k, node in enumerate(fresh)}
    if is_shared:
        ids[place.anchor] = place.newest
    if is_shared and fresh and place.newest - 1 in graph.nodes:
        joined.seams.append((place.newest - 1, ids[fresh[0].id]))
    features = reader.appearance().features
    for node in fresh:
        T_joined_sphere = place.T_joined_part @ node.T_map_sphere
        graph.add(replace(node, id=ids[node.id], T_map_sphere=T_joined_sphere))
        joined.sources[ids[node.id]] = reader.path, node.id
        joined.index.add(ids[node.id], features[node.id])

    def seen_from(sphere_id: int) -> tuple[int, SE3]:
        """Return the key sphere that stands for one of the segment, and that one by it: another one if it was left."""
        if sphere_id in ids:
            return ids[sphere_id], SE3.identity()
        return ids[place.anchor], part[place.anchor].T_map_sphere.inverse() @ part[sphere_id].T_map_sphere

    for edge in place.edges:
        graph.connect(replace(edge, b=ids[edge.b]))
    for edge in part.edges:
        a, T_a_before = seen_from(edge.a)
        if edge.b in ids and a != ids[edge.b] and (edge.a in ids or not edge.is_loop):
            graph.connect(replace(edge, a=a, b=ids[edge.b], T_a_b=T_a_before @ edge.T_a_b))
    for track in record.tracks:
        if track.stamp_ns > newest_ns:
            key_id, T_key_before = seen_from(track.key_id)
            joined.tracks.append(Track(track.stamp_ns, key_id, T_key_before @ track.T_key_sphere))
    if len(place.edges) > 1:
        joined.graph = optimize_map(graph).graph


def _span(joined: JoinedSegments, bridge: Bridge) -> None:
    """Measure the motions across the shared key spheres, and adjust all."""
    params, graph, load = bridge.params.registration, joined.graph, joined.load

    def trial(older: int, newer: int) -> LoopTrial:
        T_older_newer = graph[older].T_map_sphere.inverse() @ graph[newer].T_map_sphere
        return LoopTrial(newer, load(newer), ((older, load(older), T_older_newer),), params)

    found = bridge.run(verify, (trial(*seam) for seam in joined.seams))
    edges = [replace(edge, is_loop=False) for edge in found if edge is not None]
    if edges:
        joined.graph = optimize_map(graph.with_edges(edges)).graph


def _shared(graph: SphereGraph, part: SphereGraph) -> _Place | None:
    """Return the place of a segment by the key sphere that it begins with and the one before ends with."""
    newest = _newest(graph)
    for node in part:
        if node.stamp_ns == newest.stamp_ns:
            return _Place(newest.T_map_sphere @ node.T_map_sphere.inverse(), node.id, newest.id)
    return None


def _bridged(joined: JoinedSegments, reader: MapReader, bridge: Bridge) -> _Place | None:
    """Return the place of a segment by an alignment with the newest key sphere, else by places of all that is joined.

    Edges begin at joined key spheres and end at those of the segment, by the ids that they have there.
    """
    newest, params = _newest(joined.graph), bridge.params.registration
    after = [node for node in reader.graph if node.stamp_ns > newest.stamp_ns]
    if not after:
        return None
    reference = PreparedSphere(joined.load(newest.id), params)
    for node in after[:MAX_BRIDGED]:
        motion = find_motion(reference, PreparedSphere(reader.load_sphere(node.id), params), params)
        if motion is not None:
            T_joined_part = newest.T_map_sphere @ motion.T_a_b @ node.T_map_sphere.inverse()
            return _Place(T_joined_part, node.id, newest.id, (motion.edge(newest.id, node.id, is_loop=False),))
    return _found_again(joined, reader, after, bridge)


def _found_again(joined: JoinedSegments, reader: MapReader, after: list[KeySphere], bridge: Bridge) -> _Place | None:
    """Return the place of a segment as that of another drive."""
    shift, features = max(joined.graph.nodes) + 1, reader.appearance().features
    nodes = [replace(node, id=node.id + shift) for node in after]
    index = AppearanceIndex()
    for node in after:
        index.add(node.id + shift, features[node.id])
    known = {node.id for node in nodes}
    edges = [replace(edge, a=edge.a + shift, b=edge.b + shift) for edge in reader.graph.edges]
    drive = SphereGraph(nodes, [edge for edge in edges if edge.a in known and edge.b in known])
    part = Submap(drive, index, lambda sphere_id: reader.load_sphere(sphere_id - shift))
    joins = find_joins(Submap(joined.graph, joined.index, joined.load), part, bridge.params, bridge.run)
    if not joins.edges:
        return None
    edge = joins.edges[len(joins.edges) // 2]
    own = tuple(replace(one, b=one.b - shift) for one in joins.edges)
    return _Place(place_of_drive(joined.graph, drive, edge), edge.b - shift, _newest(joined.graph).id, own)


def _newest(graph: SphereGraph) -> KeySphere:
    return max(graph, key=lambda node: node.id)
