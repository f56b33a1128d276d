"""The folder `<MAP>.partial` of a run of `sphere_nav map`: what is mapped stays there until the whole map is complete.

It holds `plan.json` (what is mapped by which options, so that nothing else is joined to it), and for every segment of
the drive its map, a folder, and its record. A segment whose record is there is done; of any other one the torn map of
a killed run may be there, `segment_0003.partial`, which is mended or mapped again.
"""

from __future__ import annotations

import fcntl
import shutil
import tempfile
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from tqdm import tqdm

from sphere_mapping.mapper import Mapper
from sphere_nav.geometry.files.untrusted import load_json, read_text, required
from sphere_nav.geometry.files.whole_file import PART
from sphere_nav.ros.bags import BagError
from sphere_nav.ros.bags.mcap_salvage import Salvage
from sphere_nav.ros.bags.writer import PARTIAL, is_being_written
from sphere_nav.ros.maps.check import salvage_map
from sphere_nav.ros.maps.reader import FILE_NAME, SPHERE, open_map
from sphere_nav.ros.maps.writer import MapDetails, Stored, replace_map, write_stored
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.experiences import with_experience
from sphere_nav.spheres.graph import Experience, SphereGraph
from sphere_nav_tools.offline.mapping.joining import Bridge, JoinedSegments, SegmentPart, join_segments
from sphere_nav_tools.offline.mapping.plan import NAMED, MappingPlan
from sphere_nav_tools.offline.mapping.segment_work import (
    SegmentRecord,
    SegmentTask,
    map_segment,
    read_record,
    write_json,
)
from sphere_nav_tools.offline.mapping.segments import DriveSegment
from sphere_nav_tools.offline.mapping.workers import Workers

PLAN, WHOLE = "plan.json", "whole"
DEATH_S = 5.0  # in which the workers of a killed run end


class Remains:
    """What a run has mapped so far; locked while it runs."""

    def __init__(self, output: Path, folder: Path | None = None) -> None:
        """Those of a map, or in a folder; nothing is touched."""
        self.output, self.folder = output, folder or output.with_name(output.name + PARTIAL)
        self._lock: BinaryIO | None = None
        self.is_ours = False  # it is locked, and of this plan

    def begin(self, plan: MappingPlan, *, is_resumed: bool) -> None:
        """Make the folder, or go on with it; BagError where it is another run's, or was not asked for."""
        file = self.folder / PLAN
        if not self.folder.exists() or (is_resumed and all(one.suffix == PART for one in self.folder.iterdir())):
            self.folder.mkdir(parents=True, exist_ok=True)
            try:
                write_json(file, plan.options)
            except OSError:
                self.remove()
                raise
        elif not is_resumed:
            raise BagError(
                f"{self.folder}: the remains of an interrupted run: --resume goes on from them, 'sphere_nav map-verify "
                f"{self.folder} --salvage OUT' makes a map of them, or delete them"
            )
        elif not file.is_file():
            raise BagError(f"{file}: expected the plan of an interrupted run, found none: delete {self.folder}")
        self._lock = file.open("ab")
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise BagError(f"{self.folder}: is being written by another process: choose another name") from None
        except OSError:  # a file system without locks
            pass
        if is_resumed:
            check_options(file, plan.options)
        self.is_ours = True

    def map(self, plan: MappingPlan, workers: Workers) -> list[SegmentRecord]:
        """Map the segments that are not done; return the records of all."""
        missing = [segment for segment in plan.segments if not self._record(segment.name).is_file()]
        for segment in missing:
            self._clear(segment)
        if any(not segment.is_first for segment in missing):
            plan = plan.with_rig()
        is_here = len(missing) == 1 or not workers.is_apart
        tasks = (SegmentTask(plan.recipe, segment, self.folder.resolve(), is_here) for segment in missing)
        done = workers.run(map_segment, tasks)
        is_hidden = True if is_here else None
        for _ in tqdm(done, "map", len(missing), unit="segment", leave=False, disable=is_hidden):
            pass
        return [read_record(self._record(segment.name)) for segment in plan.segments]

    def map_here(self, plan: MappingPlan, make: Callable[..., Mapper]) -> list[SegmentRecord]:
        """Map a drive of one segment by a mapper that `make` returns, from the start; return its record."""
        (segment,) = plan.segments
        self._clear(segment)
        self._record(segment.name).unlink(missing_ok=True)
        map_segment(SegmentTask(plan.recipe, segment, self.folder.resolve(), is_shown=True), make)
        return [read_record(self._record(segment.name))]

    def join(
        self, plan: MappingPlan, records: Iterable[SegmentRecord], first_id: int, bridge: Bridge
    ) -> JoinedSegments:
        """Join the maps of all segments, ids from `first_id` on."""
        names = (segment.name for segment in plan.segments)
        return join_segments(
            [SegmentPart(self._map(name), record) for name, record in zip(names, records, strict=True)],
            first_id,
            bridge,
        )

    def complete(
        self, graph: SphereGraph, details: MapDetails, index: AppearanceIndex, stored: Iterable[Stored]
    ) -> None:
        """Write the whole map, and put it in its place; the remains go."""
        for left in (self.folder / WHOLE, self.folder / (WHOLE + PARTIAL)):
            shutil.rmtree(left, ignore_errors=True)
        whole = write_stored(self.folder / WHOLE, graph, details, index, stored)
        if self.output.exists():
            replace_map(whole, self.output)
        else:
            whole.rename(self.output)
        self.remove()

    def remove(self) -> None:
        """Delete all."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self.close()

    def close(self) -> None:
        """Let others go on with it."""
        if self._lock is not None:
            self._lock.close()

    @property
    def num_spheres(self) -> int:
        """Key spheres that can be read; those that two segments share count twice."""
        torn = sum(_num_readable(file) for file in self.folder.glob(f"segment_*{PARTIAL}/{FILE_NAME}"))
        whole = 0
        for record in self.folder.glob("segment_*.json"):
            if (path := self._map(record.stem)) is not None:
                with open_map(path) as reader:
                    whole += len(reader.graph)
        return whole + torn

    def salvage(self) -> int:
        """Make a map of all that is whole and has a place, in order of the segments; return how many key spheres."""
        target = self.output
        names = sorted({file.name.partition(".")[0] for file in self.folder.glob("segment_*")})
        with tempfile.TemporaryDirectory(prefix=f"{target.name}.", dir=target.parent) as folder:
            joined = join_segments([self._mended(name, Path(folder)) for name in names])
            if not len(joined.graph):
                raise BagError(f"{self.folder}: expected key spheres of a segment, found none")
            with open_map(next(iter(joined.sources.values()))[0]) as reader:
                source, rig = reader.info.source, reader.info.rig
                details = MapDetails(source=source, parameters=reader.parameters, rig=rig)
            graph = with_experience(joined.graph, self._experience(source, joined.graph), joined.graph.nodes)
            write_stored(target, graph, details, joined.index, joined.stored())
            joined.close()
        return len(joined.graph)

    def _experience(self, source: str, graph: SphereGraph) -> Experience:
        """Return what was mapped, by the name that the run was given."""
        plan = load_json(self.folder / PLAN, read_text(self.folder / PLAN, "plan of a run"))
        name = plan.get(NAMED, "") if isinstance(plan, dict) else ""
        return Experience(str(name), "", source, min(node.stamp_ns for node in graph))

    def _mended(self, name: str, folder: Path) -> SegmentPart:
        """Return a segment that is done, else what can be read of it."""
        if self._record(name).is_file():
            return SegmentPart(self._map(name), read_record(self._record(name)))
        for torn in (self.folder / name, self.folder / (name + PARTIAL)):
            with suppress(BagError, FileNotFoundError):
                salvage_map(torn, folder / name)
                return SegmentPart(folder / name, SegmentRecord())
        return SegmentPart(None, SegmentRecord())

    def _clear(self, segment: DriveSegment) -> None:
        """Delete what a killed run has left of a segment."""
        torn = self.folder / (segment.name + PARTIAL)
        until = time.monotonic() + DEATH_S
        while is_being_written(torn):
            if time.monotonic() > until:
                raise BagError(f"{torn}: is being written by another process: end it first")
            time.sleep(0.05)
        for left in (torn, self.folder / segment.name):
            shutil.rmtree(left, ignore_errors=True)

    def _record(self, name: str) -> Path:
        return self.folder / f"{name}.json"

    def _map(self, name: str) -> Path | None:
        return self.folder / name if (self.folder / name).is_dir() else None


def is_run(path: Path) -> bool:
    """Whether a path is the folder of a run that was interrupted."""
    return (path / PLAN).is_file()


def check_options(file: Path, options: dict[str, str]) -> None:
    """Raise BagError where a run was begun with another bag or other options."""
    told = load_json(file, read_text(file, "plan of a run"))
    if isinstance(told, dict):
        told.setdefault(NAMED, "")  # plans did not name the light at first
    found = required(told, str(file), list(options))
    for name, value in options.items():
        if found[name] != value:
            raise BagError(f"{file}: {name}: expected as the interrupted run had it ({found[name]}), found {value}")


def _num_readable(file: Path) -> int:
    return sum(channel.topic == SPHERE for channel, _, _ in Salvage(file).messages())
