"""Show that a change of the code's layout changed no result, bit for bit.

    python scripts/compare_results.py record .venv -o before.json --inputs inputs      # with the old version installed
    python scripts/compare_results.py record .venv -o after.json --inputs inputs       # with the new one
    python scripts/compare_results.py compare before.json after.json                   # 1 where anything differs

`record` runs the executables of an environment and keeps digests (SHA-256) of what they write. The drives in the
simulator that they read are recorded once, into the folder of inputs, and read by both versions: drives of several
processes are not the same twice. Nothing here imports a module of the project by name, but for the replay of bags,
which no executable offers to path_follower (`--replay-module` has its old and its new name).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

INSIDE = Path(__file__).resolve().with_name("inside_environment.py")
REPLAY_MODULES = ("sphere_nav.ros.bags.replay", "node_kit.replay")
FOREIGN = {  # another installation must not leak in
    *("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE"),
    *("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "COLCON_PREFIX_PATH"),
}
COMMAND_S, PATIENCE_S = 900.0, 30.0  # for a command; for a node to end after SIGINT
VOLATILE_KEYS = ("milliseconds", "seconds", "software")  # of JSON files: no results
TOWN = {"seed": 3, "world": "town", "path": "two_turns", "has_stamped_command": True}
TEACH = {"mode": "teach", "camera.period": 0.0, "sphere.width": 0, "odometry.period": 0.05}
DRIVE_TOPICS = "/pose /odometry /status /scan /odom /cmd_vel /tf_static /image_raw /camera_info /ground_truth/odometry"
MAP_FRAMES, DRIVE_FRAMES = "0:48", "48:66"  # of redkitchen
STEREO_FRAMES = "0:8"  # of kitti_06

Values = Mapping[str, Any]


class Skipped(Exception):
    """A case that cannot be run here; the message says why."""


class Failed(Exception):
    """A command that failed; the message is its last line."""


class Environment:
    """The executables of an installed version, and a scratch folder."""

    def __init__(self, folder: Path, scratch: Path, inputs: Path, data: Path, replay_modules: Sequence[str]) -> None:
        self.bin, self.scratch, self.inputs, self.data = folder.absolute() / "bin", scratch, inputs, data
        self.replay_modules = replay_modules
        self.variables = {name: value for name, value in os.environ.items() if name not in FOREIGN} | {
            "PYTHONSAFEPATH": "1",  # what is installed, not what lies in this folder
            "MPLBACKEND": "Agg",
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
            "ROS_LOG_DIR": str(scratch / "log"),
            "ROS_DOMAIN_ID": str(100 + os.getpid() % 2),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        if not (self.bin / "sphere_nav").is_file():
            raise ValueError(f"{folder}: expected an environment with bin/sphere_nav, found none")

    def call(self, *words: object) -> str:
        """Run `sphere_nav`; return what it printed."""
        return self._run([self.bin / "sphere_nav", *words])

    def inside(self, *words: object) -> Any:
        """Run `inside_environment.py` with the environment's Python; return what it found."""
        return json.loads(self._run([self.bin / "python", INSIDE, *words]).strip().splitlines()[-1])

    def _run(self, command: Sequence[object]) -> str:
        done = subprocess.run(
            [str(word) for word in command],
            capture_output=True,
            text=True,
            env=self.variables,
            cwd=self.scratch,
            timeout=COMMAND_S,
            check=False,
        )
        if done.returncode != 0:
            lines = (done.stderr.strip() or done.stdout.strip()).splitlines()
            name = " ".join(Path(str(word)).name for word in command[:2])
            raise Failed(f"{name}: status {done.returncode}: {lines[-1] if lines else 'it said nothing'}")
        return done.stdout

    @contextmanager
    def nodes(self, folder: Path, values: Mapping[str, Values]) -> Iterator[None]:
        """Run nodes with parameters by dotted name; they end, the first one first, when this is left."""
        running = []
        try:
            for name, given in values.items():
                rows = [f"    {key}: {json.dumps(value)}" for key, value in given.items()]
                parameters = folder / f"{name}.yaml"
                parameters.write_text("\n".join([f"{name}:", "  ros__parameters:", *rows, ""]), encoding="utf-8")
                with (folder / f"{name}.log").open("wb") as log:
                    command = [self.bin / name, "--ros-args", "--params-file", parameters]
                    process = subprocess.Popen(
                        [str(word) for word in command],
                        stdin=subprocess.DEVNULL,
                        stdout=log,
                        stderr=subprocess.STDOUT,
                        env=self.variables,
                        cwd=self.scratch,
                        start_new_session=True,
                    )
                running.append(process)
            yield
        finally:
            for process in running:
                end(process)

    def drive(
        self,
        folder: Path,
        recorded: Values,
        simulation: Values,
        until: float,
        others: Mapping[str, Values] | None = None,
    ) -> None:
        """Record a drive in the simulator into `<folder>/drive`, until simulated time, s."""
        recorder = {"output": str(folder / "drive"), "use_sim_time": True, **recorded}
        nodes = {"bag_recorder": recorder, **(others or {}), "cycab_sim": TOWN | dict(simulation)}
        with self.nodes(folder, nodes):
            self.inside("watch", "--until", until, *(["--start"] if others else []))

    def input(self, name: str) -> Path:
        """Return a folder of the inputs, made where it is not there yet."""
        folder = self.inputs / name
        if not folder.is_dir():
            making = folder.with_name(f"{name}.partial")
            shutil.rmtree(making, ignore_errors=True)
            making.mkdir(parents=True)
            INPUTS[name](self, making)
            making.rename(folder)
        return folder

    def recorded(self, name: str) -> Path:
        """Return a folder of the recorded data."""
        folder = self.data / name
        if not folder.is_dir():
            raise Skipped(f"no folder {name} in the recorded data")
        return folder


def end(process: subprocess.Popen[bytes]) -> None:
    """End a node as Ctrl-C would, by force if it does not."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    try:
        process.wait(PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


class Results:
    """Digests of one case, and numbers for people."""

    def __init__(self, environment: Environment) -> None:
        self.environment = environment
        self.digests: dict[str, str] = {}
        self.figures: dict[str, Any] = {}

    def add_bag(self, name: str, bag: Path, topics: Sequence[str] = (), **interval: float) -> None:
        """Add the messages of a bag by topic."""
        options = [word for key, value in interval.items() for word in (f"--{key}", value)]
        self.add_topics(name, self.environment.inside("digest", bag, *options), topics)

    def add_topics(self, name: str, found: Mapping[str, Any], topics: Sequence[str] = ()) -> None:
        """Add digests by topic, of some topics, where patterns of names are given."""
        for topic, result in found.items():
            if not topics or any(fnmatch(topic, pattern) for pattern in topics):
                self.digests[f"{name} {topic}"] = result["sha256"]
                self.figures[f"{name} {topic}"] = result["count"]

    def add_file(self, name: str, path: Path) -> None:
        """Add a text file as it is: poses, a graph, a rig."""
        lines = path.read_text(encoding="utf-8").splitlines()
        self.digests[name] = hashlib.sha256(path.read_bytes()).hexdigest()
        self.figures[f"{name}, lines"] = len(lines)
        self.figures[f"{name}, last line"] = lines[-1] if lines else ""

    def add_json(self, name: str, value: Any) -> None:
        """Add what a command says as JSON."""
        text = json.dumps(without(value, VOLATILE_KEYS), sort_keys=True)
        self.digests[name] = hashlib.sha256(text.encode()).hexdigest()


def without(value: Any, keys: Sequence[str]) -> Any:
    """Return a JSON value without some keys."""
    if isinstance(value, dict):
        return {key: without(item, keys) for key, item in value.items() if key not in keys}
    return [without(item, keys) for item in value] if isinstance(value, list) else value


# --- inputs: made once
def make_town(environment: Environment, folder: Path) -> None:
    """Spheres of a street, their map, its taught path and its cloud."""
    simulation = TEACH | {"sphere.width": 512, "capture.distance": 1.0}
    topics = "/sphere /odom /ground_truth/odometry /tf_static"
    environment.drive(folder, {"topics": topics}, simulation, 22.0)
    environment.call("map", folder / "drive", "-o", folder / "map", "--taught", folder / "taught.tum")
    environment.call("map-export", folder / "map", "-o", folder / "town.ply")


def make_return(environment: Environment, folder: Path) -> None:
    """The street driven again by camera and follower: a drive with poses, states, a laser and commands."""
    town = environment.input("town")
    environment.drive(
        folder,
        {"topics": DRIVE_TOPICS},
        {
            "mode": "drive",
            "sphere.width": 0,
            "camera.period": 0.2,
            "camera.size": "320,240",
            "odometry.period": 0.05,
            "scan.is_on": True,
            "traffic.density": "usual",
            "clock.max_wait": PATIENCE_S,
        },
        60.0,
        {
            "dense_localizer": {"map": str(town / "map"), "use_sim_time": True, "every_image": True},
            "path_follower": {
                "trajectory": str(town / "taught.tum"),
                "enable_stamped_cmd_vel": True,
                "use_sim_time": True,
            },
        },
    )


def make_panorama(environment: Environment, folder: Path) -> None:
    """The street by a panoramic camera, wheels and an IMU."""
    simulation = TEACH | {"camera.period": 0.1, "camera.model": "panorama", "camera.size": "360,96"}
    topics = "/image_raw /sphere_info /odom /imu /tf_static /ground_truth/odometry"
    more = {"camera.period": 0.5, "imu.is_on": True, "noise_seed": 2}
    environment.drive(folder, {"topics": topics}, simulation | more, 20.0)


def make_rig(kind: str) -> Callable[[Environment, Path], None]:
    """Return what records a few instants of six cameras on the roof."""

    def make(environment: Environment, folder: Path) -> None:
        rig = {"rig.kind": kind, "rig.size": "320,320", "rig.file": str(folder / "rig.yaml")}
        others = {"capture.distance": 0.8, "traffic.density": "usual"}
        environment.drive(folder, {"topic_set": "raw"}, TEACH | rig | others, 7.0)

    return make


INPUTS: dict[str, Callable[[Environment, Path], None]] = {
    "town": make_town,
    "return": make_return,
    "panorama": make_panorama,
    "ring": make_rig("ring"),
    "vertical": make_rig("vertical"),
}


# --- cases
def kitchen(env: Environment, results: Results, folder: Path) -> None:
    """RGB-D frames of redkitchen mapped, later ones localised by colour alone."""
    data = env.recorded("rgbd/redkitchen")
    for name, frames in (("taught", MAP_FRAMES), ("driven", DRIVE_FRAMES)):
        env.call("import", "seven_scenes", data, "-o", folder / name, "--frames", frames)
        results.add_bag(f"import {name}", folder / name)
    env.call("map", folder / "taught", "-o", folder / "map", "--trajectory", folder / "map.tum")
    results.add_file("trajectory", folder / "map.tum")
    results.add_bag("map", folder / "map")
    env.call("localize", folder / "map", folder / "driven", "-o", folder / "poses.tum", "--bag", folder / "bag")
    results.add_file("poses", folder / "poses.tum")
    results.add_bag("localize", folder / "bag")


def stereo(env: Environment, results: Results, folder: Path) -> None:
    """Rectified pairs of kitti_06 mapped."""
    env.call("import", "kitti", env.recorded("driving/kitti_06"), "-o", folder / "taught", "--frames", STEREO_FRAMES)
    env.call("map", folder / "taught", "-o", folder / "map", "--trajectory", folder / "map.tum")
    results.add_file("trajectory", folder / "map.tum")
    results.add_bag("map", folder / "map")


def spheres(env: Environment, results: Results, folder: Path) -> None:
    """Spheres of a street mapped; the map as cloud, graph and taught path."""
    town = env.input("town")
    env.call("map", town / "drive", "-o", folder / "map", "--taught", folder / "taught.tum")
    results.add_file("taught path", folder / "taught.tum")
    results.add_bag("map", folder / "map")
    env.call("map-export", folder / "map", "-o", folder / "graph.g2o")
    results.add_file("graph", folder / "graph.g2o")
    env.call("map-export", folder / "map", "-o", folder / "town.ply")
    results.digests["cloud"] = hashlib.sha256((folder / "town.ply").read_bytes()).hexdigest()


def drive(env: Environment, results: Results, folder: Path) -> None:
    """Another drive through the street localised in it, with wheels and traffic."""
    town, driven = env.input("town"), env.input("return")
    env.call("localize", town / "map", driven / "drive", "-o", folder / "poses.tum", "--bag", folder / "bag")
    results.add_file("poses", folder / "poses.tum")
    results.add_bag("localize", folder / "bag")


def mcl(env: Environment, results: Results, folder: Path) -> None:
    """A panoramic camera found in the bare cloud of the street."""
    town, driven = env.input("town"), env.input("panorama")
    env.call("mcl", town / "town.ply", driven / "drive", "-o", folder / "poses.tum", "--bag", folder / "bag")
    results.add_file("poses", folder / "poses.tum")
    results.add_bag("mcl", folder / "bag")


def stitched(kind: str) -> Callable[[Environment, Results, Path], None]:
    """Return the case of a rig."""

    def stitch(env: Environment, results: Results, folder: Path) -> None:
        """Instants of a rig stitched to spheres with range by stereo, and mapped."""
        rig = env.input(kind)
        trajectory = ("--trajectory", folder / "map.tum")
        env.call("map", rig / "drive", "-o", folder / "map", "--rig", rig / "rig.yaml", *trajectory)
        results.add_file("trajectory", folder / "map.tum")
        results.add_bag("map", folder / "map")

    return stitch


def commands(env: Environment, results: Results, folder: Path) -> None:
    """A recorded drive through path_follower: poses, states and laser scans in, commands out."""
    taught, driven = env.input("town") / "taught.tum", env.input("return") / "drive"
    for source in ("pose", "odometry"):
        found = env.inside("follow", driven, taught, "--source", source, "--replay-module", *env.replay_modules)
        results.add_topics(f"by {source}", found["topics"])
        results.figures |= {f"by {source}, {name}": figure for name, figure in found["figures"].items()}


def register(env: Environment, results: Results, folder: Path) -> None:
    """RGB-D pairs aligned from identity."""
    for case in ("case_1", "case_2"):
        pair = env.recorded(f"rgbd/tum_fr1_xyz_pairs/{case}")
        a, b = (f"{pair / f'img_{name}.png'},{pair / f'dep_{name}.png'}" for name in ("prev", "curr"))
        lens = ("--camera", "517.3,516.5,318.6,255.3", "--depth-units", "5000")
        env.call("register", a, b, *lens, "--json", folder / f"{case}.json")
        found = json.loads((folder / f"{case}.json").read_text(encoding="utf-8"))
        results.add_json(case, found)
        results.figures[f"{case}, translation_m"] = found["T_a_b"]["translation_m"]


def calibrate(env: Environment, results: Results, folder: Path) -> None:
    """A stereo pair calibrated by images of a board."""
    boards = env.recorded("checkerboard/opencv_stereo")
    images = [boards / f"{name}*.jpg" for name in ("left", "right")]
    env.call("calibrate", *images, "--board", "9x6", "--square", "0.025", "-o", folder / "rig.yaml")
    results.add_file("rig", folder / "rig.yaml")


def simulator(env: Environment, results: Results, folder: Path) -> None:
    """What the simulator draws and measures, from when every topic is recorded for sure."""
    rig = {"rig.kind": "ring", "rig.size": "96,96", "capture.distance": 0.3}
    camera = {"camera.period": 0.1, "camera.size": "160,120"}
    others = {"imu.is_on": True, "scan.is_on": True, "traffic.density": "usual"}
    env.drive(folder, {"topic_set": "raw"}, TEACH | rig | camera | others, SIMULATED_S[1] + 1.0)
    results.add_bag("simulator", folder / "drive", SIMULATED, since=SIMULATED_S[0], until=SIMULATED_S[1])


SIMULATED = ("/image_raw", "/cameras/*", "/camera_info", "/scan", "/imu", "/odom", "/ground_truth/odometry")
SIMULATED_S = 2.5, 6.0
CASES: dict[str, Callable[[Environment, Results, Path], None]] = {
    "kitchen": kitchen,
    "stereo": stereo,
    "spheres": spheres,
    "drive": drive,
    "mcl": mcl,
    "ring": stitched("ring"),
    "vertical": stitched("vertical"),
    "commands": commands,
    "register": register,
    "calibrate": calibrate,
    "simulator": simulator,
}


def record(arguments: argparse.Namespace) -> int:
    """Run the cases, write what they gave; 1 where one failed."""
    cases, inputs = {}, arguments.inputs.absolute()
    for name in arguments.only or CASES:
        with tempfile.TemporaryDirectory(prefix="compare_results_") as scratch:
            folder, begun = Path(scratch), time.monotonic()
            env = Environment(arguments.environment, folder, inputs, arguments.data.absolute(), arguments.replay_module)
            case = cases[name] = run_case(name, env, folder)
        case["seconds"] = round(time.monotonic() - begun, 1)
        told = case.get("skipped") or case.get("failed") or f"{len(case['digests'])} digests"
        say(f"{name:<10} {case['seconds']:6.1f} s  {told}")
    found = {"inputs": digest_files(inputs), "cases": cases}
    arguments.output.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return int(any("failed" in case for case in cases.values()))


def run_case(name: str, env: Environment, folder: Path) -> dict[str, Any]:
    """Return the digests and figures of one case, or why there are none."""
    results = Results(env)
    try:
        CASES[name](env, results, folder)
    except Skipped as reason:
        return {"skipped": str(reason)}
    except (Failed, subprocess.TimeoutExpired) as error:
        return {"failed": str(error)}
    return {"digests": results.digests, "figures": results.figures}


def digest_files(folder: Path) -> dict[str, str]:
    """Return the digest of each folder of inputs."""
    found = {}
    for name in sorted(path.name for path in folder.glob("*") if path.is_dir() and path.suffix != ".partial"):
        sha = hashlib.sha256()
        for path in sorted(item for item in (folder / name).rglob("*") if item.is_file()):
            sha.update(f"{path.relative_to(folder)}\n".encode())
            sha.update(path.read_bytes())
        found[name] = sha.hexdigest()
    return found


# --- comparison
def differences(before: Mapping[str, Any], after: Mapping[str, Any], ignored: Sequence[str] = ()) -> list[list[str]]:
    """Return what differs between two records as rows of case, what, before and after; an empty list if nothing does.

    A digest or a case that only one side has is a difference, and so is a case that failed, even on both sides.
    `ignored` are patterns of `case what`.
    """
    rows = []
    for name in sorted(before["inputs"].keys() & after["inputs"].keys()):
        if before["inputs"][name] != after["inputs"][name]:
            rows.append(["inputs", name, before["inputs"][name][:12], after["inputs"][name][:12]])
    for name in ordered(before["cases"], after["cases"]):
        sides = [side["cases"].get(name) for side in (before, after)]
        told = [outcome(side) for side in sides]
        if told[0] != told[1] or any(text.startswith("failed") for text in told):
            rows.append([name, "", *told])
            continue
        digests = [side.get("digests", {}) for side in sides if side is not None]
        for what in ordered(*digests):
            found = [side.get(what, "none")[:12] for side in digests]
            if found[0] != found[1] and not any(fnmatch(f"{name} {what}", pattern) for pattern in ignored):
                figures = [side.get("figures", {}).get(what) for side in sides if side is not None]
                pairs = zip(found, figures, strict=True)
                rows.append([name, what, *(text if count is None else f"{text} ({count})" for text, count in pairs)])
    return rows


def outcome(case: Mapping[str, Any] | None) -> str:
    """Return how a case ended."""
    if case is None:
        return "not recorded"
    return next((f"{word}: {case[word]}" for word in ("failed", "skipped") if word in case), "done")


def ordered(*sides: Mapping[str, Any]) -> list[str]:
    """Return the names of all, each once, in their order."""
    return list(dict.fromkeys(name for side in sides for name in side))


def read_record(path: Path) -> dict[str, Any]:
    """Return what `record` wrote; ValueError where that is something else."""
    try:
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        dict(found["cases"])
    except (OSError, ValueError, TypeError, LookupError) as error:
        raise ValueError(f"{path}: expected a record of this script, found: {error}") from None
    return found


def compare(arguments: argparse.Namespace) -> int:
    """Print a table of the cases and one of what differs; 1 where anything does, or nothing was compared."""
    before, after = (read_record(path) for path in (arguments.before, arguments.after))
    for side in (before, after):
        side["cases"] = {
            name: case for name, case in side["cases"].items() if name in (arguments.only or side["cases"])
        }
    rows, num_equal = differences(before, after, arguments.ignore), 0
    for name in ordered(before["cases"], after["cases"]):
        mine, case = [row for row in rows if row[0] == name], before["cases"].get(name, {})
        if "skipped" in case and not mine:
            verdict = f"skipped: {case['skipped']}"
        else:
            shared = len(case.get("digests", {}).keys() & after["cases"].get(name, {}).get("digests", {}).keys())
            num_equal += not mine
            verdict = f"{len(mine)} DIFFER" if mine else f"equal ({shared} digests)"
        say(f"{name:<10} {verdict}")
    if rows:
        say("\n| case | what | before | after |\n| --- | --- | --- | --- |")
        say("\n".join(f"| {' | '.join(row)} |" for row in rows))
    say("equal, bit for bit" if num_equal and not rows else "NOT EQUAL" if rows else "NOTHING COMPARED")
    return int(bool(rows) or not num_equal)


def say(text: str) -> None:
    """Print at once."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def main(words: Sequence[str] | None = None) -> int:
    """Record or compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    todo = parser.add_subparsers(required=True)
    recording = todo.add_parser("record", help="run the cases with one version")
    recording.set_defaults(run=record)
    recording.add_argument("environment", type=Path, metavar="ENVIRONMENT", help="such as .venv")
    recording.add_argument("-o", "--output", type=Path, required=True, metavar="FILE")
    recording.add_argument("--inputs", type=Path, default=Path("out/compare_inputs"), help="(%(default)s)")
    recording.add_argument("--data", type=Path, default=Path("../shared/data"), help="recorded data (%(default)s)")
    recording.add_argument("--only", nargs="+", choices=CASES, metavar="CASE", help=", ".join(CASES))
    recording.add_argument("--replay-module", nargs="+", default=REPLAY_MODULES, metavar="NAME", help="(%(default)s)")
    comparing = todo.add_parser("compare", help="tell what differs between two records")
    comparing.set_defaults(run=compare)
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    comparing.add_argument(
        "--ignore", action="append", default=[], metavar="PATTERN", help="of 'CASE WHAT': what is not compared"
    )
    comparing.add_argument("--only", nargs="+", choices=CASES, metavar="CASE", help="these cases")
    arguments = parser.parse_args(words)
    try:
        status: int = arguments.run(arguments)
    except ValueError as error:
        sys.stderr.write(f"compare_results.py: {error}\n")
        return 2
    return status


if __name__ == "__main__":
    sys.exit(main())
