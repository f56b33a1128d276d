"""READ FIRST. The learning phase, offline: a drive through the very callbacks of the nodes -> a map.

Plan what is mapped by what; map each segment of the drive, behind the stitcher where it holds the cameras of a rig;
join the segments; close loops; join the drive to the map that is extended; anchor it to the truth; merge redundant key
spheres; complete the map, and report. Whatever ends it before, what is mapped stays, and `--resume` goes on from it.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Iterable
from contextlib import ExitStack, closing
from dataclasses import dataclass
from itertools import chain
from typing import cast

from sphere_mapping.mapper import Mapper
from sphere_mapping.ros.saving import details_of
from sphere_nav.geometry.files.untrusted import MAX_FILE_BYTES, read_text
from sphere_nav.geometry.trajectory import write_tum
from sphere_nav.ros.bags import BagError
from sphere_nav.ros.maps.condensing import condense
from sphere_nav.ros.maps.reader import MapReader
from sphere_nav.ros.maps.writer import MAP_FRAME, Stored, check_free
from sphere_nav.ros.service import one_line
from sphere_nav.spheres.experiences import with_experience
from sphere_nav.spheres.graph import Experience
from sphere_nav_tools.offline.mapping.drive import MappedDrive, truth_of
from sphere_nav_tools.offline.mapping.drive_locator import DriveLocator
from sphere_nav_tools.offline.mapping.extension import extend, open_base, place_start
from sphere_nav_tools.offline.mapping.joining import Bridge, JoinedSegments
from sphere_nav_tools.offline.mapping.plan import MappingPlan, make_plan
from sphere_nav_tools.offline.mapping.remains import Remains
from sphere_nav_tools.offline.mapping.segment_work import SegmentRecord
from sphere_nav_tools.offline.mapping.thinning import Thinner
from sphere_nav_tools.offline.mapping.workers import NUM_THREADS, Workers, limit_threads

ORIGINS = {"truth": "the true poses of the drive", "survey": "the survey of its key spheres"}


def learn(arguments: argparse.Namespace) -> int:
    """Map what the bag holds; what is mapped of it stays until the map is complete."""
    if arguments.output.exists() and not arguments.overwrite:
        raise BagError(f"{arguments.output}: expected no such file or folder, found one: --overwrite replaces a map")
    if arguments.extend and arguments.anchor != "first":
        raise BagError(f"--anchor: expected first, as --extend keeps the frame of its map, found {arguments.anchor}")
    check_free(arguments.output, is_overwriting=arguments.overwrite)
    limit_threads(NUM_THREADS)
    rig = read_text(arguments.rig, "rig file", MAX_FILE_BYTES) if arguments.rig else ""
    with ExitStack() as stack:
        base = stack.enter_context(open_base(arguments.extend, arguments.output, rig)) if arguments.extend else None
        plan, remains = make_plan(arguments, rig), Remains(arguments.output)
        stack.callback(remains.close)
        known = stack.enter_context(closing(Base.of(base))) if base is not None else None
        try:
            remains.begin(plan, is_resumed=arguments.resume)
            with Workers(arguments.jobs, arguments.scheduler) as workers:
                return map_plan(arguments, plan, remains, known, workers)
        except (ValueError, OSError, KeyboardInterrupt) as error:
            return keep(arguments, remains, error)


@dataclass(frozen=True, eq=False)
class Base:
    """The map that is extended, and what localises the drive in it."""

    reader: MapReader
    locator: DriveLocator

    @classmethod
    def of(cls, reader: MapReader) -> Base:
        """Return a map, made ready to be localised in."""
        return cls(reader, DriveLocator(reader))

    def close(self) -> None:
        """End the localiser."""
        self.locator.close()


def map_plan(
    arguments: argparse.Namespace, plan: MappingPlan, remains: Remains, base: Base | None, workers: Workers
) -> int:
    """Map the segments of a drive, join them, complete the map."""
    records = remains.map(plan, workers) if base is None else remains.map_here(plan, base.locator.make_mapper)
    params, first_id = plan.params.mapper, max(base.reader.graph.nodes) + 1 if base is not None else 0
    joined = remains.join(plan, records, first_id, Bridge(params, workers.run))
    drive = drive_of(plan, records, joined)
    if not drive.mapper.tracks:
        reason = drive.refusal or "no complete instant"
        raise BagError(f"{arguments.bag}: expected spheres to map, found none: {reason}")
    plan.judge(drive)
    return finish_map(arguments, drive, remains, base, joined, workers, plan.recipe.details.rig)


def drive_of(plan: MappingPlan, records: list[SegmentRecord], joined: JoinedSegments) -> MappedDrive:
    """Return what was mapped in segments as one drive."""
    mapper = Mapper(plan.params.mapper, store=joined)
    mapper.take_over(joined.graph, joined.tracks, joined.index, sum(record.num_loops for record in records))
    mapper.origin = records[0].origin
    refused: dict[str, int] = {}
    for words, number in chain.from_iterable(record.refused.items() for record in records):
        refused[words] = refused.get(words, 0) + number
    damages = list(dict.fromkeys(chain.from_iterable(record.damages for record in records)))
    mount = next((record.mount for record in records if record.tracks), records[0].mount)
    return MappedDrive(mapper, mount, joined.num_lost, refused, damages)


def finish_map(
    arguments: argparse.Namespace,
    drive: MappedDrive,
    remains: Remains,
    base: Base | None,
    joined: JoinedSegments,
    workers: Workers,
    rig: str,
) -> int:
    """Close loops, join the drive to a map, compare with the truth, complete the map."""
    mapper, told = drive.mapper, list[str]()
    source, frame, stored = arguments.bag.name, MAP_FRAME, cast("Iterable[Stored]", ())
    if not arguments.no_loops:
        mapper.close_loops(workers.run)
    mapper.graph = with_experience(mapper.graph, describe_drive(arguments, drive), mapper.graph.nodes)
    index, new = mapper.appearance, set[int]()
    if base is not None:
        known = base.reader
        start = place_start(known, arguments.start, drive.mount.T_base_sphere) if arguments.start else None
        extension = extend(known, mapper, base.locator, start, workers.run)
        index, told, stored, new = extension.index, [extension.told], known.stored(), extension.new
        source, frame = f"{known.info.source} + {source}", known.info.header.frame_id
    truth = truth_of(arguments.bag)
    T_new_map, graph, warnings = drive.anchor_graph(arguments.anchor, truth, str(arguments.bag))
    origin = base.reader.origin if base is not None else ORIGINS.get(arguments.anchor, mapper.origin)
    ways = [drive.trajectory(is_base=is_base).moved(T_new_map) for is_base in (False, True)]
    thinner = Thinner(mapper, joined, base.reader if base is not None else None, arguments.budget)
    graph, condensed, left = thinner.thin(graph, ways[0].positions, new)
    told += left
    details = details_of(graph, mapper.params, source, frame, rig, origin)
    remains.complete(graph, details, index, condense(chain(stored, joined.stored()), condensed))
    joined.close()
    for path, way in zip((arguments.trajectory, arguments.taught), ways, strict=True):
        if path:
            write_tum(path, way, details.map_id)
    size = sum(file.stat().st_size for file in arguments.output.iterdir())
    made = f"map: {arguments.output}, {size / 1e6:.1f} MB; its frame: {origin}"
    print("\n".join([*drive.summary(truth), *told, *warnings, made]))
    if drive.loss:
        print(f"sphere_nav map: {arguments.bag}: {drive.loss}", file=sys.stderr)
    return 1 if drive.loss else 0


def describe_drive(arguments: argparse.Namespace, drive: MappedDrive) -> Experience:
    """Return what the key spheres of a drive have in common."""
    graph = drive.mapper.graph
    camera = drive.mapper.load_sphere(min(graph.nodes)).camera
    kind = f"{drive.kind} {camera.width} x {camera.height}"
    return Experience(arguments.experience, kind, arguments.bag.name, min(node.stamp_ns for node in graph))


def keep(arguments: argparse.Namespace, remains: Remains, error: BaseException) -> int:
    """Say in one line what stays of a run that ended before its time, and how it goes on; return the exit status.

    Where nothing was mapped nothing stays, and the error is raised again.
    """
    if not remains.is_ours:
        raise error
    number = remains.num_spheres
    if not number:
        remains.remove()
        raise error
    words = [word for word in arguments.words if word != "--resume"]
    command = shlex.join(["sphere_nav", *words, "--resume"])
    why = "interrupted" if isinstance(error, KeyboardInterrupt) else one_line(error)
    print(f"sphere_nav map: {why}; {number} key spheres stay in {remains.folder}: {command}", file=sys.stderr)
    return 130 if isinstance(error, KeyboardInterrupt) else 1
