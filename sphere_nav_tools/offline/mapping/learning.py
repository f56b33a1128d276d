"""READ FIRST. The learning phase, offline: a drive through the very callbacks of the nodes -> a map.

Plan what is mapped by what; map the drive, behind the stitcher where it holds the cameras of a rig; close loops; join
the drive to the map that is extended; anchor it to the truth; merge redundant key spheres; complete the map, and
report. Whatever ends it before, the key spheres so far stay in a file that `map-verify --salvage` makes a map of.
"""

from __future__ import annotations

import argparse
import shlex
import shutil
import sys
from collections.abc import Callable, Collection, Iterable
from contextlib import ExitStack
from functools import partial
from itertools import chain
from typing import cast

from sphere_mapping.experiences.budget import describe_loss, thin
from sphere_mapping.graph.merging import merge
from sphere_mapping.mapper import Mapper
from sphere_mapping.ros.saving import details_of
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.files.untrusted import MAX_FILE_BYTES, read_text
from sphere_nav.geometry.trajectory import write_tum
from sphere_nav.ros.bags import BagError
from sphere_nav.ros.bags.writer import PARTIAL
from sphere_nav.ros.maps.compact import CompactFeatures
from sphere_nav.ros.maps.reader import MapReader, open_map
from sphere_nav.ros.maps.writer import MAP_FRAME, MapWriter, Stored, check_free, write_stored
from sphere_nav.ros.service import one_line
from sphere_nav.spheres.experiences import with_experience
from sphere_nav.spheres.graph import Experience, SphereGraph
from sphere_nav_tools.offline.mapping.drive import MappedDrive
from sphere_nav_tools.offline.mapping.extension import (
    LocatedMapper,
    drive_localizer,
    extend,
    open_base,
    place_start,
)
from sphere_nav_tools.offline.mapping.replay_mapper import Recipe, make_recipe, replay_mapper
from sphere_nav_tools.offline.mapping.workers import NUM_THREADS, Workers, limit_threads

DRIVE = ".drive"  # after the name of the map: where a drive is written as it is mapped
ORIGINS = {"truth": "the true poses of the drive", "survey": "the survey of its key spheres"}


def learn(arguments: argparse.Namespace) -> int:
    """Map what the bag holds; what is mapped of it stays until the map is complete."""
    if arguments.extend and arguments.anchor != "first":
        raise BagError(f"--anchor: expected first, as --extend keeps the frame of its map, found {arguments.anchor}")
    check_free(arguments.output, is_overwriting=arguments.overwrite)
    limit_threads(NUM_THREADS)
    rig = read_text(arguments.rig, "rig file", MAX_FILE_BYTES) if arguments.rig else ""
    with ExitStack() as stack:
        base = stack.enter_context(open_base(arguments.extend, arguments.output, rig)) if arguments.extend else None
        recipe = make_recipe(arguments, rig)
        kind: Callable[..., Mapper] = Mapper
        if base is not None:
            localizer = drive_localizer(base)
            stack.callback(localizer.references.close)
            kind = partial(LocatedMapper, base, localizer)
        writer = MapWriter(arguments.output.with_name(arguments.output.name + DRIVE), recipe.details)
        try:
            with Workers(arguments.jobs, arguments.scheduler) as workers:
                return map_drive(arguments, recipe, writer, kind, workers)
        except (ValueError, OSError, KeyboardInterrupt) as error:
            return keep(writer, error)


def map_drive(
    arguments: argparse.Namespace, recipe: Recipe, writer: MapWriter, kind: Callable[..., Mapper], workers: Workers
) -> int:
    """Map a drive by a kind of mapper, complete the map."""
    make = partial(kind, store=writer, features=CompactFeatures())
    drive = replay_mapper(recipe, make, workers.executor if recipe.stitcher else None)
    if not drive.mapper.tracks:
        reason = drive.refusal or "no complete instant"
        raise BagError(f"{arguments.bag}: expected spheres to map, found none: {reason}")
    writer.finish(drive.mapper.graph, appearance=drive.mapper.appearance)
    with open_map(writer.path) as mapped:
        status = finish_map(arguments, drive, mapped, workers)
    shutil.rmtree(writer.path)
    return status


def finish_map(arguments: argparse.Namespace, drive: MappedDrive, mapped: MapReader, workers: Workers) -> int:
    """Close loops, join the drive to a map, anchor it, complete the map; `mapped`: the drive alone."""
    mapper, told, known = drive.mapper, list[str](), None
    source, frame, stored = arguments.bag.name, MAP_FRAME, cast("Iterable[Stored]", ())
    if not arguments.no_loops:
        mapper.close_loops(workers.run)
    mapper.graph = with_experience(mapper.graph, describe_drive(arguments, drive), mapper.graph.nodes)
    index, new = mapper.appearance, set[int]()
    if isinstance(mapper, LocatedMapper):
        known = mapper.base
        start = place_start(known, arguments.start, drive.mount.T_base_sphere) if arguments.start else None
        index, words, new = extend(mapper, start, workers.run)
        told, stored = [words], known.stored()
        source, frame = f"{known.info.source} + {source}", known.info.header.frame_id
    T_new_map, graph, warnings = drive.anchor_graph(arguments.anchor, arguments.bag)
    origin = known.origin if known is not None else ORIGINS.get(arguments.anchor, mapper.origin)
    T_base_sphere = known.T_base_sphere if known is not None else mapper.T_base_sphere
    ways = [drive.trajectory(is_base=is_base).moved(T_new_map) for is_base in (False, True)]
    graph, left = thin_map(mapper, known, arguments.budget, graph, ways[0].positions, new)
    told += left
    details = details_of(graph, mapper.params, source, frame, drive.recipe.details.rig, (origin, T_base_sphere))
    whole = chain(stored, mapped.stored())
    write_stored(arguments.output, graph, details, index, whole, is_overwriting=arguments.overwrite)
    for path, way in zip((arguments.trajectory, arguments.taught), ways, strict=True):
        if path:
            write_tum(path, way, details.map_id)
    size = sum(file.stat().st_size for file in arguments.output.iterdir())
    made = f"map: {arguments.output}, {size / 1e6:.1f} MB; its frame: {origin}"
    print("\n".join([*drive.summary(), *told, *warnings, made]))
    if drive.loss:
        print(f"sphere_nav map: {arguments.bag}: {drive.loss}", file=sys.stderr)
    return 1 if drive.loss else 0


def thin_map(
    mapper: Mapper,
    known: MapReader | None,
    budget: int | None,
    graph: SphereGraph,
    positions: Array,
    new: Collection[int],
) -> tuple[SphereGraph, list[str]]:
    """Return the graph that is written, and what is told of what it goes without.

    known: the map that the drive extends; budget: experiences that a place may hold; positions (P, 3): of all spheres
    of the drive; new: key spheres that show what the map did not.
    """
    told, kept = list[str](), graph
    if mapper.params.key.merge:
        kept = merge(graph, positions, known.graph.nodes if known is not None else (), new)
        told += describe_loss(graph, kept, "merged with others of their places")
    if budget is not None:
        merged, is_whole = kept, mapper.load_sphere(mapper.tracks[0].key_id).camera.is_whole
        kept = thin(merged, budget, is_whole=is_whole)
        told += describe_loss(merged, kept, "left for the budget")
    return kept, told


def describe_drive(arguments: argparse.Namespace, drive: MappedDrive) -> Experience:
    """Return what the key spheres of a drive have in common."""
    graph = drive.mapper.graph
    camera = drive.mapper.load_sphere(min(graph.nodes)).camera
    kind = f"{drive.recipe.kind} {camera.width} x {camera.height}"
    return Experience(arguments.experience, kind, arguments.bag.name, min(node.stamp_ns for node in graph))


def keep(writer: MapWriter, error: BaseException) -> int:
    """Say in one line what stays of a run that ended before its time; return the exit status.

    Where nothing was mapped nothing stays, and the error is raised again.
    """
    if not writer.num_spheres:
        writer.discard()
        raise error
    writer.leave()
    why = "interrupted" if isinstance(error, KeyboardInterrupt) else one_line(error)
    if writer.path.exists():
        kept = f"the drive alone stays as the map {writer.path}"
    else:
        command = shlex.join(["sphere_nav", "map-verify", f"{writer.path}{PARTIAL}", "--salvage", "OUT"])
        kept = f"{writer.num_spheres} key spheres stay: {command}"
    print(f"sphere_nav map: {why}; {kept}", file=sys.stderr)
    return 130 if isinstance(error, KeyboardInterrupt) else 1
