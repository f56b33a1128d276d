"""The processes of a page, which end with this one: what records a drive and maps it, a simulated vehicle.

They are the programs that a user types. The folder is a wall: only what lies in it, links followed, is offered or
found; nothing is told of anything else.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

from path_follower.routes.network_file import network_path
from sphere_nav.ros.bags.writer import PARTIAL
from sphere_nav.ros.service import MAX_LINE
from sphere_nav_tools.cli.processes import Processes, claim_domain, node_command, python_command
from sphere_nav_tools.offline.routes import map_id_of

SIMULATION = {
    "has_stamped_command": False,  # the clock waits for nobody
    "camera.period": 0.2,
    "camera.size": "448,336",
    "capture.when": "always",
    "capture.distance": 1.5,
}
CLOCK = {"use_sim_time": True}
SIMULATOR, NAVIGATOR = "cycab_sim", "route_navigator"
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}", re.ASCII)
MAPPING = (  # then its check, which tells what it found
    "from sphere_nav_tools.cli.main import main; "
    "sys.exit(main(sys.argv[1:]) or main(['map-verify', sys.argv[sys.argv.index('-o') + 1]]))"
)
PATHS = (".tum", ".csv")
LOG_HEAD = re.compile(r"(\[[^\]]*\] ){2}\[[^\]]*\]: ")  # level, stamp and node of a line in the log


class Teaching(Processes):
    """One job at a time in one folder: NAME (the bag), NAME_map, NAME.tum."""

    def __init__(self, folder: Path, record: Sequence[str], mapping: Sequence[str]) -> None:
        """`record`: words for bag_recorder after its output; `mapping`: more words for `sphere_nav map`."""
        super().__init__(folder.resolve())
        self._record, self._mapping = tuple(record), tuple(mapping)
        self._process: subprocess.Popen[bytes] | None = None
        self._job, self.name, self._begun = "", "", 0.0

    def check_name(self, name: str) -> str:
        """Return why a drive cannot have this name; empty where it can."""
        if not NAME.fullmatch(name):
            return f"name: expected letters, digits, _ and -, found {name[:64]!r}"
        taken = [path.name for path in self._made(name) if os.path.lexists(path)]
        return f"name: expected a new one, found {taken[0]} in {self.folder}" if taken else ""

    def record(self, name: str) -> str:
        """Begin to record."""
        words = ["--ros-args", "-p", f"output:={self.folder / name}", *self._record]
        return (
            self.busy or self.check_name(name) or self._begin("recording", name, node_command("bag_recorder", *words))
        )

    def finish(self) -> str:
        """End the recording in order."""
        if self._process is None or not self.is_recording:
            return "nothing is being recorded"
        self._process.send_signal(signal.SIGINT)
        return f"{self.name}: the recording is being completed"

    def map(self, name: str) -> str:
        """Make a map of a recorded drive."""
        if self.busy or name not in self.drives:
            return self.busy or f"drive: expected a recorded one in {self.folder}, found none"
        bag, made, taught = self._made(name)
        words = ["map", str(bag), "-o", str(made), "--taught", str(taught), *self._mapping]
        return self._begin("mapping", name, python_command(MAPPING, *words))

    @property
    def busy(self) -> str:
        """What is going on; empty where nothing is."""
        is_running = self._process is not None and self._process.poll() is None
        return f"{self._job} {self.name} is not over" if is_running else ""

    @property
    def is_recording(self) -> bool:
        """Whether a drive is being recorded."""
        return self._job == "recording" and bool(self.busy)

    @property
    def drives(self) -> list[str]:
        """Names of what was recorded here, and is complete."""
        bags = {path.parent for path in self.folder.glob("*/*.mcap") if path.name != "map.mcap"}
        return sorted(path.name for path in bags if NAME.fullmatch(path.name) and self._holds(path))

    @property
    def paths(self) -> list[str]:
        """Names of the files here that a path can be in, taught ones first: a rig file may be among the others."""
        found = [
            path for path in self.folder.iterdir() if path.suffix in PATHS and path.is_file() and self._holds(path)
        ]
        return [path.name for path in sorted(found, key=lambda path: (PATHS.index(path.suffix), path.name))]

    def path_of(self, name: str) -> Path | None:
        """Return the file of a path; None for a name that is not offered."""
        return self.folder / name if name in self.paths else None

    def with_map(self, map_id: str) -> Path | None:
        """Return the map in the folder that has this id; None where there is none."""
        maps = filter(None, map(self.map_of, self.drives))
        return next((made for made in maps if map_id and map_id_of(made) == map_id), None)

    def map_of(self, drive: str) -> Path | None:
        """Return the map of a drive; None where there is none."""
        made = self._made(drive)[1]
        return made if drive in self.drives and made.is_dir() and self._holds(made) else None

    def _holds(self, path: Path) -> bool:
        """Whether a file, or a folder with all that is in it, lies here, links followed."""
        is_here = Path(os.path.realpath(path)).is_relative_to(self.folder)
        return is_here and all(self._holds(part) for part in path.glob("*"))

    def describe(self) -> str:
        """Return in one line what is going on, or how it ended."""
        if self._process is None:
            return ""
        status, head = self._process.poll(), f"{self._job} {self.name}:"
        said = LOG_HEAD.sub("", self.last_words(f"{self.name}.{self._job}"))[:MAX_LINE]
        if status is not None:
            return f"{head} {'done' if status == 0 else f'FAILED ({status})'} {said}".strip()
        if self._job == "recording":
            size = sum(path.stat().st_size for path in (self.folder / (self.name + PARTIAL)).glob("*"))
            said = f"{size / 1e6:.1f} MB, {shutil.disk_usage(self.folder).free / 1e9:.0f} GB left"
        return f"{head} {time.monotonic() - self._begun:.0f} s {said}".strip()

    def _made(self, name: str) -> tuple[Path, Path, Path]:
        return self.folder / name, self.folder / f"{name}_map", self.folder / f"{name}.tum"

    def _begin(self, job: str, name: str, command: list[str]) -> str:
        self._job, self.name, self._begun = job, name, time.monotonic()
        self._process = self.begin(f"{name}.{job}", command)
        return f"{job} {name}"


class SimulatedVehicle(Processes):
    """The simulator, and the nodes that drive it; they end with this."""

    def __init__(self, folder: Path) -> None:
        """`folder`: where what they say is kept."""
        super().__init__(folder / "simulator_logs", claim_domain())
        self.start(SIMULATOR, SIMULATION)

    @property
    def is_driven(self) -> bool:
        """Whether the nodes that drive run."""
        return len(self.running) > 1

    def use(self, made: Path, taught: Path) -> str:
        """Drive by a map along the path that was taught with it; nothing moves before start is pressed."""
        self.rest()
        self.start("dense_localizer", CLOCK | {"map": str(made)})
        self.start("path_follower", CLOCK | {"trajectory": str(taught)})
        self.guide(made)
        return f"{made.name}: localiser and follower start"

    def guide(self, made: Path) -> None:
        """Start the node that drives to the places of a map, anew after one was named."""
        if NAVIGATOR in self.running:
            self.stop(NAVIGATOR)
        if network_path(made).exists():
            self.start(NAVIGATOR, CLOCK | {"network": str(network_path(made))})

    def rest(self) -> str:
        """End the nodes that drive: until `use` it is driven by hand."""
        for node in [node for node in reversed(self.running) if node != SIMULATOR]:
            self.stop(node)
        return "localiser and follower have ended: drive by hand, then localise again"
