"""`sphere_nav demo`: the main job from end to end in the simulator."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from cycab_sim.params import CONDITIONS, SimParams
from cycab_sim.sensors.cameras import rig_camera_names
from cycab_sim.world.worlds import build_world
from sphere_nav.geometry.arrays import Array
from sphere_nav.geometry.trajectory import Trajectory, read_tum
from sphere_nav.params import build
from sphere_nav.ros.bags.writer import free_path
from sphere_nav.ros.maps.reader import open_map
from sphere_nav_tools.cli.constants import MAX_LATERAL, MIN_DRIVEN, PAUSE_AT
from sphere_nav_tools.cli.demo.watch import WatchedDrive
from sphere_nav_tools.cli.processes import claim_domain
from sphere_nav_tools.offline.evaluation import Judged, evaluate_poses, read_poses
from sphere_nav_tools.offline.settings import add, choose, flag
from sphere_nav_tools.offline.tables import facts_as_lines, write_json

HELP = """\
Teach, map and drive: a simulated Cycab is driven once along a path with two 90 degree turns while the six cameras on
its roof are recorded, their images are stitched to spheres with range by stereo and mapped, and the car drives the path
again by one camera and cmd_vel alone: on another day, with other cars and people about, and clouds before the sun.

Writes map, bags, a picture and result.json below --output. Exit status 1 if the drive left the path or did not
finish it.

examples:
  sphere_nav demo
  sphere_nav demo --seed 7 --path block --output out/seven
  sphere_nav demo --path tour --traffic
  sphere_nav demo --condition overcast
"""
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
EXAGGERATION = 50  # of the distance between two paths that no eye could tell apart
WAY = 0.1  # m that a metre on the way counts beside one on the ground, so that a path may cross itself


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("-o", "--output", type=Path, default=Path("out/demo"), metavar="DIR", help="(%(default)s)")
    add(parser, "--seed", "SEED", "decides the town and every noise (%(default)s)", int, default=1)
    paths = ("two_turns", "block", "straight", "tour")
    choose(parser, "--path", paths, "tour: 490 m of a city (%(default)s)", "two_turns")
    flag(parser, "--traffic", "twice as much of it")
    told = f"light and season of the second drive: {', '.join(CONDITIONS)} (as in the first, with clouds)"
    told += "; a map of one light may not serve another"
    add(parser, "--condition", "NAME", told, default="", choices=("", *CONDITIONS))


def run(arguments: argparse.Namespace) -> int:
    """Do the whole job, print the table of errors, write everything that was made."""
    demo = Demo(arguments)
    try:
        demo.teach()
        demo.map()
        demo.drive()
    except RuntimeError as error:
        print(f"demo: {error}; what the nodes said is in {demo.folder}")
        return 1
    return demo.judge()


class Demo:
    """One run: its folder, its domain, and how the drive ended."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        self.domain = claim_domain()
        place = TOUR if arguments.path == "tour" else {"path": arguments.path}
        traffic = BUSY if arguments.traffic else {}
        self.simulation = SIMULATION | {"seed": arguments.seed} | place | traffic
        self.other_day = OTHER_DAY | {"condition": arguments.condition}
        params = build(SimParams, self.simulation)
        self.length = build_world(params.world, params.seed, params.path).path.length
        self.folder = new_folder(arguments.output)

    def nodes(self, name: str) -> WatchedDrive:
        """Return an empty set of nodes whose output goes to a folder of the stage."""
        print(f"{name} ...", flush=True)
        return WatchedDrive(self.folder / f"{name}_logs", self.domain)

    def teach(self) -> None:
        """Drive the path once by the simulator's driver and record the cameras."""
        with self.nodes("teach") as nodes:
            nodes.start("bag_recorder", {"output": str(self.folder / "teach"), "topics": TEACH_TOPICS})
            rig = {"rig.file": str(self.folder / "rig.yaml")}
            nodes.start("cycab_sim", self.simulation | LOCK_STEP | TEACHING | rig)
            nodes.wait("teaching drive", lambda: nodes.has_told("taught"), self.length)
            nodes.stop("bag_recorder")

    def map(self) -> None:
        """Make the map from the recording, by the command that a user types."""
        from sphere_nav_tools.cli.main import main

        print("map ...", flush=True)
        teach, made, rig, taught = (str(self.folder / name) for name in ("teach", "map", "rig.yaml", "taught.tum"))
        if main(["map", teach, "-o", made, "--rig", rig, "--taught", taught]) != 0:
            raise RuntimeError("mapping failed")

    def drive(self) -> None:
        """Drive the path again: camera, localiser, follower, cmd_vel, over DDS in lock-step."""
        clock = {"use_sim_time": True}
        with self.nodes("drive") as nodes:
            nodes.start("bag_recorder", clock | {"output": str(self.folder / "drive"), "topics": DRIVE_TOPICS})
            nodes.start("dense_localizer", clock | {"map": str(self.folder / "map"), "every_image": True})
            nodes.wait_for("dense_localizer/reset")
            paused = {"mode": "drive", "clock.pause_at": PAUSE_AT}
            nodes.start("cycab_sim", self.simulation | LOCK_STEP | paused | self.other_day)
            taught = {"trajectory": str(self.folder / "taught.tum"), "enable_stamped_cmd_vel": True}
            nodes.start("path_follower", clock | taught)  # time stands until it is there
            nodes.wait("localisation", lambda: nodes.has_told("paused"))
            nodes.call("path_follower/start")
            nodes.call("cycab_sim/resume")
            nodes.wait("drive by the camera", lambda: has_ended(nodes.state("follower")), self.length)
            self.has_finished = nodes.state("follower").startswith("FINISHED")
            self.end = nodes.describe()
            nodes.stop("bag_recorder")

    def judge(self) -> int:
        """Compare with the taught drive, draw, write result.json; 1 where the drive left the path."""
        errors = drive_errors(self.folder)
        with open_map(self.folder / "map") as made:
            keys = np.stack(
                [(errors.judged.T_truth_estimate @ node.T_map_sphere).translation[:2] for node in made.graph]
            )
        plot_top_view(self.folder / "top_view.png", errors, keys)
        result = self.result(errors, len(keys))
        write_json(self.folder / "result.json", result)
        print("\n".join([*facts_as_lines(result), f"picture, map and bags: {self.folder}", verdict(result)]))
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
        print(f"the last result is kept as {wanted.rename(free_path(wanted))}")
    wanted.mkdir(parents=True)
    return wanted


# --- errors against the taught drive, both by the simulator's truth
@dataclass(frozen=True, eq=False)
class DriveErrors:
    """The true poses in motion, and how far to the left of the taught path they are: lateral (N,) m; yaw (N,) there.

    `judged`: the poses of the localiser against the truth, the map put where the taught drive was.
    """

    taught: Trajectory
    driven: Trajectory
    yaw: Array
    lateral: Array
    share_driven: float
    judged: Judged


def drive_errors(folder: Path) -> DriveErrors:
    """Compare the drive with the teaching drive in the folder of a demo."""
    teach, truth = read_truth(folder / "teach"), read_truth(folder / "drive")
    estimate, by = read_poses(folder / "drive", ("/pose",)), (read_tum(folder / "taught.tum"), teach)
    judged = evaluate_poses(estimate, truth, alignment="poses", is_interpolated=True, aligned_by=by)
    taught, driven = _in_motion(teach), _in_motion(truth)
    feet, lateral = distances_from(taught, driven)
    share = float(taught.distances[feet.max()] / taught.distances[-1])
    return DriveErrors(taught, driven, taught.T_map_body.yaw[feet], lateral, share, judged)


def distances_from(taught: Trajectory, driven: Trajectory) -> tuple[NDArray[np.intp], Array]:
    """Return which taught pose is closest to each driven one, and how far that is to the left of it (N,), m."""
    places, wanted = (np.column_stack([one.positions[:, :2], WAY * one.distances]) for one in (taught, driven))
    _, feet = KDTree(places).query(wanted)
    yaw, off = taught.T_map_body.yaw[feet], driven.positions - taught.positions[feet]
    return feet, np.cos(yaw) * off[:, 1] - np.sin(yaw) * off[:, 0]


def read_truth(bag: Path) -> Trajectory:
    """Return the true poses of the vehicle in a bag of the simulator."""
    return read_poses(bag, ("/ground_truth/odometry",))


def _in_motion(trajectory: Trajectory) -> Trajectory:
    """Return the first pose, and every one that is elsewhere than the one before."""
    return trajectory[np.diff(trajectory.distances, prepend=-1.0) > 0.0]


def plot_top_view(path: Path, errors: DriveErrors, key_spheres: Array) -> None:
    """Draw the taught path, the driven one beside it and the key spheres (K, 2) from above, metres.

    The driven path is `EXAGGERATION` times as far from the taught one as the car truly was.
    """
    from sphere_nav_tools.offline.plot_figure import drawn, top_view  # matplotlib takes half a second to import

    label = f"driven by the camera (truth), its distance from the taught path × {EXAGGERATION}"
    with drawn(path, (8, 8)) as figure:
        axes = figure.add_subplot()
        lines = {"taught (truth)": errors.taught.positions[:, :2], label: exaggerate(errors)}
        top_view(axes, lines, {f"{len(key_spheres)} key spheres": key_spheres})
        axes.set_title(f"Taught and driven path, at most {100 * np.abs(errors.lateral).max():.1f} cm apart", loc="left")


def exaggerate(errors: DriveErrors) -> Array:
    """Return the driven positions (N, 2), `EXAGGERATION` times as far from the taught path."""
    left = np.stack([-np.sin(errors.yaw), np.cos(errors.yaw)], axis=1)
    exaggerated: Array = errors.driven.positions[:, :2] + (EXAGGERATION - 1) * errors.lateral[:, None] * left
    return exaggerated
