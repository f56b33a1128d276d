"""`sphere_nav demo`: the main job from end to end in the simulator."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from cycab_sim.params import CONDITIONS, SimParams
from cycab_sim.sensors.rigs import rig_camera_names
from cycab_sim.world.worlds import build_world
from sphere_nav.params import build
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.maps.reader import open_map
from sphere_nav_tools.cli.constants import MAX_LATERAL, MIN_DRIVEN, PAUSE_AT
from sphere_nav_tools.cli.demo.domains import claim_domain
from sphere_nav_tools.cli.demo.report import DriveErrors, drive_errors, find_map
from sphere_nav_tools.cli.demo.watch import DriveFailed, DriveMonitor
from sphere_nav_tools.cli.processes import Processes
from sphere_nav_tools.offline.tables import facts_as_lines, write_json

HELP = """\
Teach, map and drive: a simulated Cycab is driven once along a path with two 90 degree turns while the six cameras on
its roof are recorded, their images are stitched to spheres with range by stereo and mapped, and the car drives the path
again by one camera and cmd_vel alone: on another day, with other cars and people about, and clouds before the sun.

Writes maps, bags, plots and result.json below --output. Exit status 1 if the drive left the path or did not finish it.

examples:
  sphere_nav demo
  sphere_nav demo --seed 7 --path block --output out/seven
  sphere_nav demo --path tour --traffic
  sphere_nav demo --mounting inverted
  sphere_nav demo --condition overcast
"""
BAR = "{desc}: {percentage:3.0f}% |{bar}| {n:.0f} of {total:.0f} m, {elapsed}, {remaining} left"
SIMULATION = {
    "has_stamped_command": True,
    "camera.period": 0.2,
    "camera.size": "448,336",  # another kind of camera than that of the spheres, and quick to draw
    "odometry.period": 0.05,
    "rig.kind": "vertical",  # three stereo pairs back to back (M15 section 4.3)
    "rig.size": "416,416",
    "capture.distance": 1.5,
    "sphere.width": 0,
    "traffic.density": "usual",
}
TOUR = {"world": "city", "teach.speed": 1.2}  # 490 m through streets, a square and a lane (M15 section 6.4.4)
BUSY = {"traffic.density": "busy"}
MOUNTINGS = {  # of the camera that drives
    "upright": {},
    "pitched": {"camera.mounting_deg": "1,0,1.6,0,30,0"},
    "rolled": {"camera.mounting_deg": "1,0,1.6,90,4,0"},
    "inverted": {"camera.mounting_deg": "1,0,1.6,180,4,0"},
}
OTHER_DAY = {  # the second drive meets other people, clouds before the sun, and a camera that heeds them
    "traffic.seed": 1,
    "light.clouds": 0.7,
    "imaging.has_automatic_exposure": True,
    "imaging.white_balance": 0.03,
}
LOCK_STEP = {"clock.is_strict": True, "clock.real_time_factor": 0.0}  # time waits, however slow the computer
TEACHING = {"mode": "teach", "camera.period": 0.0}  # the rig sees what is mapped, the camera drives later
RIG_TOPICS = " ".join(f"/cameras/{name}/image_raw /cameras/{name}/camera_info" for name in rig_camera_names("vertical"))
TEACH_TOPICS = f"{RIG_TOPICS} /odom /ground_truth/odometry /tf_static"
DRIVE_TOPICS = (
    "/pose /odometry /status /cmd_vel /tracking_error /path_follower/status /path_follower/trajectory "
    "/ground_truth/odometry /odom /camera_info /tf /tf_static /diagnostics"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("-o", "--output", type=Path, default=Path("out/demo"), metavar="DIR", help="(%(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="decides the town and every noise (%(default)s)")
    paths = ("two_turns", "block", "straight", "tour")
    parser.add_argument("--path", default="two_turns", choices=paths, help="tour: 490 m of a city (%(default)s)")
    parser.add_argument("--traffic", action="store_true", help="twice as much of it")
    parser.add_argument(
        "--mounting", default="upright", choices=tuple(MOUNTINGS), help="how the driving camera sits (%(default)s)"
    )
    told = f"light and season of the second drive: {', '.join(CONDITIONS)} (as in the first, with clouds)"
    told += "; a map of one light may not serve another"
    parser.add_argument("--condition", default="", choices=("", *CONDITIONS), metavar="NAME", help=told)
    parser.add_argument("--domain", type=int, default=None, metavar="N", help="ROS domain (a free one of 50 to 99)")


def run(arguments: argparse.Namespace) -> int:
    """Do the whole job, print the table of errors, write everything that was made."""
    more = (BUSY if arguments.traffic else {}) | MOUNTINGS[arguments.mounting]
    demo = Demo(arguments.output, arguments.seed, arguments.path, arguments.domain, more, arguments.condition)
    try:
        demo.teach()
        demo.map()
        demo.drive()
    except (DriveFailed, RuntimeError) as error:
        print(f"demo: {error}; what the nodes said is in {demo.folder}")
        return 1
    return demo.judge()


class Demo:
    """One run: its folder, its domain, and how long each stage took."""

    def __init__(
        self, output: Path, seed: int, path: str, domain: int | None, more: Mapping[str, Any], condition: str = ""
    ) -> None:
        """`more`: parameters of the simulator that are not those of every demo; `condition`: of the second drive."""
        self.domain = claim_domain() if domain is None else domain
        place = TOUR if path == "tour" else {"path": path}
        self.other_day = OTHER_DAY | {"condition": condition}
        self.simulation = SIMULATION | {"seed": seed} | place | dict(more)
        params = build(SimParams, self.simulation)
        self.length = build_world(params.world, params.seed, params.path).path.length
        self.folder = new_folder(output)
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure the time of a stage."""
        print(f"{name} ...", flush=True)
        begun = time.monotonic()
        try:
            yield
        finally:
            self.seconds[name] = round(time.monotonic() - begun, 1)

    def teach(self) -> None:
        """Drive the path once by the simulator's driver and record the cameras."""
        with self.stage("teach"), self.processes("teach") as processes, DriveMonitor(processes, self.domain) as watch:
            processes.start("bag_recorder", {"output": str(self.folder / "teach"), "topics": TEACH_TOPICS})
            processes.start(
                "cycab_sim",
                self.simulation | LOCK_STEP | TEACHING | {"rig.file": str(self.folder / "rig.yaml")},
            )
            self.follow(watch, "teaching drive", lambda: watch.has_told("taught"))
            processes.stop("bag_recorder")

    def map(self) -> None:
        """Make the map from the recording, by the command that a user types."""
        from sphere_nav_tools.cli.main import main

        teach, made = str(self.folder / "teach"), str(self.folder / "map")
        taught = str(self.folder / "taught.tum")
        with self.stage("map"):
            if main(["map", teach, "-o", made, "--rig", str(self.folder / "rig.yaml"), "--taught", taught]) != 0:
                raise RuntimeError("mapping failed")

    def drive(self) -> None:
        """Drive the path again: camera, localiser, follower, cmd_vel, over DDS in lock-step."""
        clock = {"use_sim_time": True}
        with self.stage("drive"), self.processes("drive") as processes, DriveMonitor(processes, self.domain) as watch:
            processes.start("bag_recorder", clock | {"output": str(self.folder / "drive"), "topics": DRIVE_TOPICS})
            processes.start("dense_localizer", clock | {"map": str(self.folder / "map"), "every_image": True})
            watch.wait_for("dense_localizer/reset")
            paused = {"mode": "drive", "clock.pause_at": PAUSE_AT}
            processes.start("cycab_sim", self.simulation | LOCK_STEP | paused | self.other_day)
            taught = {"trajectory": str(self.folder / "taught.tum"), "enable_stamped_cmd_vel": True}
            processes.start("path_follower", clock | taught)  # time stands until it is there
            watch.wait("localisation", lambda: watch.has_told("paused"), is_moving=False)
            watch.call("path_follower/start")
            watch.call("cycab_sim/resume")
            self.follow(watch, "drive by the camera", lambda: has_ended(watch.state("follower")))
            self.has_finished = watch.state("follower").startswith("FINISHED")
            self.end = watch.describe()
            processes.stop("bag_recorder")

    def follow(self, watch: DriveMonitor, what: str, has_ended: Callable[[], bool]) -> None:
        """Show how far the car is until the drive has ended."""
        with tqdm(total=round(self.length), desc=what, bar_format=BAR, mininterval=0.5, disable=None) as bar:
            watch.wait(what, has_ended, is_moving=True, bar=bar)

    def processes(self, name: str) -> Processes:
        """Return an empty set of processes whose output goes to a folder of the stage."""
        folder = self.folder / f"{name}_logs"
        folder.mkdir()
        return Processes(folder, self.domain)

    def judge(self) -> int:
        """Compare with the taught drive, draw, write result.json; 1 where the drive left the path."""
        from sphere_nav_tools.cli.demo import plots  # matplotlib takes half a second to import
        from sphere_nav_tools.offline import plot_figure

        with self.stage("judge"):
            T_world_map = find_map(self.folder)
            errors = drive_errors(self.folder / "teach", self.folder / "drive", T_world_map)
            with open_map(self.folder / "map") as made:
                keys = np.stack([(T_world_map @ node.T_map_sphere).translation[:2] for node in made.graph])
            with BagReader(self.folder / "drive") as bag:
                statuses = plot_figure.read_statuses(bag, "/status")
            plots.plot_top_view(self.folder / "top_view.png", errors, keys)
            plot_figure.draw_localization(self.folder / "errors.png", errors.estimate, errors.judged, statuses)
        result = self.result(errors, len(keys))
        write_json(self.folder / "result.json", result)
        print("\n".join([*facts_as_lines(result), f"plots, map and bags: {self.folder}", verdict(result)]))
        return 0 if result["has_followed"] else 1

    def result(self, errors: DriveErrors, num_key_spheres: int) -> dict[str, Any]:
        """Return what result.json holds."""
        worst = float(np.abs(errors.lateral).max())
        return {
            "lateral_rmse_m": float(np.sqrt(np.mean(errors.lateral**2))),
            "lateral_max_m": worst,
            "longitudinal_rmse_m": errors.judged.report["longitudinal_m"]["rmse"],
            "share_driven": errors.share_driven,
            "has_finished": self.has_finished,
            "has_followed": self.has_finished and worst <= MAX_LATERAL and errors.share_driven >= MIN_DRIVEN,
            "end": self.end,
            "length_m": self.length,
            "num_key_spheres": num_key_spheres,
            "seed": self.simulation["seed"],
            "seconds": self.seconds,
        }


def has_ended(follower: str) -> bool:
    """Whether the follower's state is an end; it drives on by itself where only a slow machine held up the clock."""
    return follower.startswith(("FINISHED", "STOPPED")) and "CLOCK_STOPPED" not in follower


def verdict(result: dict[str, Any]) -> str:
    """Return in words whether the drive has followed the path."""
    if result["has_followed"]:
        return "the drive followed the taught path to its end"
    return "THE DRIVE LEFT THE TAUGHT PATH" if result["has_finished"] else "THE DRIVE DID NOT FINISH"


def new_folder(wanted: Path) -> Path:
    """Make the output folder; one that is there is kept under the next free number."""
    if wanted.exists():
        number = next(n for n in range(1, 10_000) if not wanted.with_name(f"{wanted.name}.{n}").exists())
        kept = wanted.rename(wanted.with_name(f"{wanted.name}.{number}"))
        print(f"the last result is kept as {kept}")
    wanted.mkdir(parents=True)
    return wanted
