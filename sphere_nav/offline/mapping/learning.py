"""READ FIRST. The learning phase, offline: a drive through the very callbacks of the nodes -> a map.

Replay the bag to the mapper, behind the stitcher where it holds the cameras of a rig; close loops; join the drive to
the map that is extended; anchor it to the truth; merge redundant key spheres; complete the map, and report.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Collection, Iterable
from contextlib import ExitStack, closing
from dataclasses import dataclass
from typing import cast

from sphere_mapping.experiences.budget import thin
from sphere_mapping.graph.merging import merge
from sphere_mapping.mapper import Mapper
from sphere_mapping.ros.saving import details_of
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.untrusted import MAX_FILE_BYTES, read_text
from sphere_nav.geometry.trajectory import write_tum
from sphere_nav.offline.mapping.drive import MappedDrive, truth_of
from sphere_nav.offline.mapping.drive_locator import DriveLocator
from sphere_nav.offline.mapping.extension import extend, open_base, place_start
from sphere_nav.offline.mapping.replay_mapper import map_bag
from sphere_nav.offline.mapping.workers import NUM_THREADS, Workers, limit_threads
from sphere_nav.ros.bags import BagError
from sphere_nav.ros.maps.reader import MapDetails, MapReader, MapWriter
from sphere_nav.ros.maps.writer import MAP_FRAME, Stored
from sphere_nav.spheres.experiences import with_experience
from sphere_nav.spheres.graph import Experience, SphereGraph

ORIGINS = {"truth": "the true poses of the drive", "survey": "the survey of its key spheres"}


def learn(arguments: argparse.Namespace) -> int:
    """Map what the bag holds; each key sphere is written as it is kept."""
    if arguments.output.exists() and not arguments.overwrite:
        raise BagError(f"{arguments.output}: expected no such file or folder, found one: --overwrite replaces a map")
    if arguments.extend and arguments.anchor != "first":
        raise BagError(f"--anchor: expected first, as --extend keeps the frame of its map, found {arguments.anchor}")
    limit_threads(NUM_THREADS)
    rig = read_text(arguments.rig, "rig file", MAX_FILE_BYTES) if arguments.rig else ""
    with ExitStack() as stack:
        workers = stack.enter_context(Workers(arguments.jobs, arguments.scheduler))
        base = stack.enter_context(open_base(arguments.extend, arguments.output, rig)) if arguments.extend else None
        details = MapDetails(source=arguments.bag.name, rig=rig)
        locator = stack.enter_context(closing(DriveLocator(base))) if base is not None else None
        writer = MapWriter(arguments.output, details, is_overwriting=arguments.overwrite)
        try:
            first = max(base.graph.nodes) + 1 if base is not None else 0
            drive = map_bag(arguments, writer, first, workers, locator.make_mapper if locator else Mapper)
            return finish_map(arguments, drive, writer, Base(base, locator) if base and locator else None, workers)
        except (ValueError, OSError):  # an interrupted run leaves what it has, for `map-verify --salvage`
            writer.discard()
            raise


@dataclass(frozen=True, eq=False)
class Base:
    """The map that is extended, and where the drive was localised in it."""

    reader: MapReader
    locator: DriveLocator


def finish_map(
    arguments: argparse.Namespace, drive: MappedDrive, writer: MapWriter, base: Base | None, workers: Workers
) -> int:
    """Close loops, join the drive to a map, compare with the truth, complete the map."""
    mapper, told = drive.node.mapper, list[str]()
    source, frame, stored = arguments.bag.name, MAP_FRAME, cast("Iterable[Stored]", ())
    mapper.keep_end()
    if not arguments.no_loops:
        mapper.close_loops(workers.run)
    mapper.graph = with_experience(mapper.graph, describe_drive(arguments, drive), mapper.graph.nodes)
    index, new = mapper.appearance, set[int]()
    if base is not None:
        map0, T_base_sphere = base.reader, drive.node.mount.T_base_sphere
        start = place_start(map0, arguments.start, T_base_sphere) if arguments.start else None
        extension = extend(map0, mapper, base.locator, start, workers.run)
        index, told, stored = extension.index, [extension.told], map0.stored()
        source, frame = f"{map0.info.source} + {source}", map0.info.header.frame_id
        new = extension.new
    truth = truth_of(arguments.bag)
    T_new_map, graph, warnings = drive.anchor_graph(arguments.anchor, truth, str(arguments.bag))
    origin = base.reader.origin if base is not None else ORIGINS.get(arguments.anchor, mapper.origin)
    ways = [drive.trajectory(is_base=is_base).moved(T_new_map) for is_base in (False, True)]
    graph, left = thin_map(arguments, graph, mapper, ways[0].positions, writer, base, new)
    told += left
    details = details_of(graph, drive.node.params.mapper, source, frame, writer.details.rig, origin)
    writer.finish(graph, details, index, stored)
    for path, way in zip((arguments.trajectory, arguments.taught), ways, strict=True):
        if path:
            write_tum(path, way, details.map_id)
    size = sum(file.stat().st_size for file in arguments.output.iterdir())
    made = f"map: {arguments.output}, {size / 1e6:.1f} MB; its frame: {origin}"
    print("\n".join([*drive.summary(truth), *told, *warnings, made]))
    if drive.loss:
        print(f"sphere_nav map: {arguments.bag}: {drive.loss}", file=sys.stderr)
    return 1 if drive.loss else 0


def thin_map(
    arguments: argparse.Namespace,
    graph: SphereGraph,
    mapper: Mapper,
    positions: Array,
    writer: MapWriter,
    base: Base | None,
    new: Collection[int],
) -> tuple[SphereGraph, list[str]]:
    """Return the graph without what is redundant, or beyond the budget, and what is told of that."""
    told, known = [], base.reader if base is not None else None
    if mapper.params.key.merge:
        merged = merge(graph, positions, known.graph.nodes if known is not None else (), new)
        told += [f"{len(merged.replaced)} key spheres merged with others of their places"] if merged.replaced else []
        graph = merged.graph
    if arguments.budget is not None:
        num_bytes = writer.num_bytes + (known.num_bytes if known is not None else 0)
        is_whole = mapper.load_sphere(mapper.tracks[0].key_id).camera.is_whole
        thinned = thin(graph, arguments.budget, num_bytes / len(mapper.graph), is_whole=is_whole)
        told += [f"{len(thinned.replaced)} key spheres left for the budget"] if thinned.replaced else []
        graph = thinned.graph
    return graph, told


def describe_drive(arguments: argparse.Namespace, drive: MappedDrive) -> Experience:
    """Return what the key spheres of a drive have in common."""
    graph = drive.node.mapper.graph
    camera = drive.node.mapper.load_sphere(min(graph.nodes)).camera
    kind = f"{drive.kind} {camera.width} x {camera.height}"
    return Experience(arguments.experience, kind, arguments.bag.name, min(node.stamp_ns for node in graph))
