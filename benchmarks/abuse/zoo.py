"""Recordings of anybody's: `inspect` each, run every command that it prints to its end, count the lines of refusals."""

from __future__ import annotations

import argparse
import contextlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path

from benchmarks import commands
from benchmarks.abuse.zoo_bags import RIG, Exhibit, base_pose, exhibits, six_cameras, write_room
from benchmarks.report import Bound, Headline, Report, Table
from sphere_nav.geometry import Rig
from sphere_nav.geometry.files.rig_file import write_rig
from sphere_nav_tools.cli.bags.inspect_ import CLOUD_FILE, MAP, RIG_FILE

# What a user of so small images and so bare a room would add.
FEWER_PIXELS = ("--set", "acceptance.min_pixels=200", "--set", "alignment.num_levels=4")
SMALL_SPHERES = ("--set-stitcher", "stitch.width=256")
SMALL_ROOM = ("area.step=0.5", "resampling.num_particles=200", "synthesis.num_columns=180")
NEVER_FOUND = 1  # status of `mcl` where it located no image: a bare box looks the same from many places


@dataclass
class Visit:
    """What came of one exhibit: the jobs that were offered, and what was not as it should be, a line each."""

    name: str
    jobs: list[str] = field(default_factory=list)
    num_commands: int = 0
    num_refusals: int = 0
    faults: list[str] = field(default_factory=list)


def run(options: argparse.Namespace) -> Report:
    """Visit the whole zoo, or every seventh recording from one that the seed says."""
    chosen = exhibits()[options.seed % 7 :: 7] if options.size == "quick" else exhibits()
    keeper = Keeper(options.folder)
    visits = [keeper.visit(one) for one in chosen]
    report, rows = Report("zoo"), []
    for v in visits:
        counts = v.num_commands, v.num_refusals, len(v.faults)
        rows.append((v.name, ", ".join(v.jobs) or "nothing", *map(str, counts)))
    columns = ("recording", "offered", "commands run", "refusals", "faults")
    report.tables.append(Table("Recordings", columns, rows))
    faults = [(visit.name, fault.replace("|", "/")) for visit in visits for fault in visit.faults]
    if faults:
        report.tables.append(Table("Faults", ("recording", "what"), faults))
    num_commands, num_refusals = (sum(getattr(v, name) for v in visits) for name in ("num_commands", "num_refusals"))
    what, told = f"faults in {num_commands} commands and {num_refusals} refusals", f"{len(visits)} foreign recordings"
    report.bounds.append(Bound(what, 0, len(faults), "", headline=Headline("robustness", told)))
    return report


class Keeper:
    """Builds exhibits in a folder and does with each what `inspect` says can be done."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._room = write_room(folder / "room.ply")
        self._last: Path | None = None  # a map

    def visit(self, exhibit: Exhibit) -> Visit:
        """Return what came of one."""
        visit = Visit(exhibit.name)
        folder = self._folder / exhibit.name
        folder.mkdir()
        bag = exhibit.build(folder)
        with contextlib.chdir(folder):
            self._inspect(visit, exhibit, bag)
        return visit

    def _inspect(self, visit: Visit, exhibit: Exhibit, bag: Path) -> None:
        said = commands.run("inspect", bag, "--json", "offer.json")
        if said.status == 2 or not Path("offer.json").exists():
            visit.faults.append(f"inspect: expected offers, found {said.err!r:.300}")
            return
        offers = json.loads(Path("offer.json").read_text())["jobs"]
        visit.jobs = [offer["job"] for offer in offers if offer["command"]]
        if set(visit.jobs) != set(exhibit.jobs):
            missing = "; ".join(offer["missing"] for offer in offers if offer["missing"])
            expected = ", ".join(exhibit.jobs) or "nothing"
            visit.faults.append(f"inspect: expected {expected}, found {', '.join(visit.jobs) or 'nothing'}: {missing}")
        for offer in offers:
            visit.num_refusals += not offer["command"]
            lines = [line for line in said.out.splitlines() if line.startswith(offer["job"])]
            if not offer["command"] and (not offer["missing"] or "\n" in offer["missing"] or len(lines) != 1):
                visit.faults.append(f"inspect: {offer['job']}: expected one line, found {offer['missing']!r}")
        if exhibit.words not in "; ".join(offer["missing"] for offer in offers if not offer["command"]):
            told = [offer["missing"] for offer in offers if offer["missing"]]
            visit.faults.append(f"inspect: expected words {exhibit.words!r}, found {told}")
        for offer in offers:
            if offer["command"]:
                visit.num_commands += 1
                self._carry_out(visit, offer["job"], offer["command"][1:])
            elif offer["job"] != "mcl":
                self._try_without(visit, offer["job"], bag)

    def _carry_out(self, visit: Visit, job: str, command: Sequence[str]) -> None:
        """Run a command that was offered; what stands for a file of the user is one."""
        if RIG_FILE in command:
            write_rig(RIG_FILE, named_rig(command))
        words = [self._own(word) for word in command]
        words += {"map": SMALL_SPHERES * (RIG_FILE in command), "localize": FEWER_PIXELS}.get(job, ())
        if job == "mcl":
            words += [word for setting in SMALL_ROOM for word in ("--set", setting)]
            start = ",".join(f"{v:.4f}" for v in [*base_pose(0).translation, *base_pose(0).quaternion])
            words.append(f"--initial-pose={start}")
            words += ["--json", "mcl.json"]
        said = commands.run(*words)
        if job == "mcl" and said.status == NEVER_FOUND and json.loads(Path("mcl.json").read_text())["images"] > 0:
            return
        if said.status != 0:
            found = f"status {said.status}: {(said.err or said.out)!r:.300}"
            visit.faults.append(f"{job}: expected status 0, found {found}")

    def _own(self, word: str) -> str:
        if word == CLOUD_FILE:
            return str(self._room)
        if word != MAP:
            return word
        made = next(iter(sorted(Path().glob("*_map/map.mcap"))), None)
        self._last = made.parent.absolute() if made else self._whole
        return str(self._last)

    @cached_property
    def _whole(self) -> Path:
        """A map of the room in all directions."""
        folder = self._folder / "whole"
        folder.mkdir()
        bag = Exhibit("rig", partial(six_cameras, num=2)).build(folder)
        write_rig(folder / RIG_FILE, RIG)
        words = [f"--camera={name}=/{name}/image_raw" for name in RIG.names]
        commands.call("map", bag, "-o", folder / "m", "--rig", folder / RIG_FILE, *words, *SMALL_SPHERES)
        return folder / "m"

    def _try_without(self, visit: Visit, job: str, bag: Path) -> None:
        """Run a command that was not offered: it is refused in one line, too."""
        given = [bag] if job == "map" else [self._last or self._whole, bag]
        said = commands.run(job, *given, "-o", "never.tum")
        visit.num_refusals += 1
        lines = [line for line in said.err.splitlines() if line.strip()]
        if said.status != 2 or len(lines) != 1:
            found = f"status {said.status}, {len(lines)} lines: {said.err!r:.300}"
            visit.faults.append(f"expected a refusal in one line, found {found}")


def named_rig(command: Iterable[str]) -> Rig:
    """Return the rig with the names that a command gives its cameras."""
    parts = []
    for word in command:
        if word.startswith("--camera="):
            _, name, topic = word.split("=")
            own = next(known for known in RIG.names if known in topic)
            parts.append(replace(RIG.camera(own), name=name))
    return Rig(tuple(parts))
