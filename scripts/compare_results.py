"""Show that a change of the code's layout changed no result, bit for bit.

    .venv/bin/python scripts/compare_results.py record -o before.json   # by the Python with the old version installed
    .venv/bin/python scripts/compare_results.py record -o after.json    # by that with the new one
    python scripts/compare_results.py compare before.json after.json    # 1 where anything differs

`record` runs the commands beside its Python and keeps digests of what they write. The simulated drives that they read
are those of `sphere_nav demo`, made once into the folder of inputs: drives of several processes are never the same.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import json
import os
import struct
import subprocess
import sys
import tempfile
import time
from array import array
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import numpy as np

NS, COMMAND_S = 1_000_000_000, 1800.0
VOLATILE = {  # fields that tell how long it took, or by which program: no results
    "sphere_nav_msgs/msg/LocalizationStatus": {"milliseconds"},
    "sphere_nav_msgs/msg/KeySphereGraph": {"software"},
    "sphere_nav_msgs/msg/MapInfo": {"software", "parameters"},
}
CALLS = {60: "pause", 90: "resume", 150: "stop", 230: "start"}  # by the operator, so many statuses after the start
FRONT = ("--image", "/cameras/top_front/image_raw", "--info", "/cameras/top_front/camera_info")


class Skipped(Exception):
    """A case that cannot be run here; the message says why."""


class Results:
    """Digests of one case, and how its commands are run."""

    def __init__(self, folder: Path, inputs: Path, data: Path) -> None:
        self.folder, self.inputs, self.data = folder, inputs, data
        self.digests: dict[str, str] = {}

    def call(self, *words: object) -> None:
        """Run `sphere_nav`; RuntimeError with its last line where it fails."""
        threads = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONSAFEPATH": "1"}
        command = [str(Path(sys.executable).with_name("sphere_nav")), *map(str, words)]
        where: dict[str, Any] = {"env": threads, "cwd": self.folder, "timeout": COMMAND_S}
        done = subprocess.run(command, capture_output=True, text=True, check=False, **where)
        if done.returncode != 0:
            lines = (done.stderr.strip() or done.stdout.strip() or "it said nothing").splitlines()
            raise RuntimeError(f"sphere_nav {words[0]}: status {done.returncode}: {lines[-1]}")

    def recorded(self, name: str) -> Path:
        """Return a folder of the recorded data."""
        if not (self.data / name).is_dir():
            raise Skipped(f"no folder {name} in the recorded data")
        return self.data / name

    def demo(self) -> Path:
        """Return the output of a demo: a drive with a rig, its map and taught path, a drive along it."""
        if not (self.inputs / "demo" / "result.json").is_file():
            self.call("demo", "-o", self.inputs / "demo")
        return self.inputs / "demo"

    def add_messages(self, name: str, messages: Iterable[tuple[str, str, Any]]) -> None:
        """Add topics, types and messages by topic, in the order of their stamps; parameters by themselves."""
        found: dict[str, list[tuple[int, bytes]]] = defaultdict(list)
        for topic, kind, message in messages:
            found[topic].append((stamp_ns(message), digest(message, VOLATILE.get(kind, ())).digest()))
            if kind == "sphere_nav_msgs/msg/MapInfo":
                found[f"{topic}.parameters"].append((0, digest(message.parameters).digest()))
        for topic, parts in sorted(found.items()):
            ordered = sorted(parts, key=lambda part: part[0])  # stable: of one stamp, as recorded
            self.digests[f"{name} {topic}"] = hashlib.sha256(b"".join(part for _, part in ordered)).hexdigest()

    def add_made(self, *names: str) -> None:
        """Add files and bags that commands wrote."""
        for name in names:
            path = self.folder / name
            if path.is_dir():
                self.add_messages(name, read_bag(path))
            else:
                self.digests[name] = hashlib.sha256(path.read_bytes()).hexdigest()


def read_bag(bag: Path) -> Iterator[tuple[str, str, Any]]:
    """Yield topic, type and message of all files of a bag."""
    from mcap.reader import make_reader
    from rclpy.serialization import deserialize_message

    for path in sorted(bag.glob("*.mcap")):
        with path.open("rb") as file:
            for schema, channel, item in make_reader(file).iter_messages():
                assert schema is not None, channel.topic
                package, _, name = schema.name.split("/")
                kind = getattr(importlib.import_module(f"{package}.msg"), name)
                yield channel.topic, schema.name, deserialize_message(item.data, kind)


def stamp_ns(message: Any) -> int:
    """Return the stamp of a message, 0 for one that has none."""
    return message.header.stamp.sec * NS + message.header.stamp.nanosec if hasattr(message, "header") else 0


def digest(value: Any, skipped: Iterable[str] = (), sha: Any = None) -> Any:
    """Return SHA-256 of a value of a message: a bit, text or number with its kind, or the parts of a message or list.

    The bytes of a serialized message will not do: what is between two aligned fields is not defined.
    """
    sha = sha or hashlib.sha256()
    if hasattr(value, "get_fields_and_field_types"):
        for name in value.get_fields_and_field_types():
            if name not in skipped:
                digest(getattr(value, name), (), sha)
    elif isinstance(value, (array, np.ndarray)):
        data = np.asarray(value)
        sha.update(f"{data.dtype.str}{data.size}:".encode() + data.tobytes())
    elif isinstance(value, str | bytes | bytearray):
        raw = value.encode() if isinstance(value, str) else value
        sha.update(f"b{len(raw)}:".encode() + raw)
    elif isinstance(value, float):
        sha.update(struct.pack("<cd", b"f", value))
    elif isinstance(value, int):
        sha.update(f"i{int(value)}:".encode())
    else:
        sha.update(f"l{len(value)}:".encode())
        for item in value:
            digest(item, (), sha)
    return sha


def kitchen(results: Results) -> None:
    """RGB-D frames of redkitchen mapped, later ones localised by colour alone."""
    for name, frames in (("taught", "0:48"), ("driven", "48:66")):
        results.call("import", "seven_scenes", results.recorded("rgbd/redkitchen"), "-o", name, "--frames", frames)
    results.call("map", "taught", "-o", "map", "--trajectory", "map.tum")
    results.call("localize", "map", "driven", "-o", "poses.tum", "--bag", "bag")
    results.add_made("taught", "driven", "map.tum", "map", "poses.tum", "bag")


def stereo(results: Results) -> None:
    """Rectified pairs of kitti_06 mapped."""
    results.call("import", "kitti", results.recorded("driving/kitti_06"), "-o", "taught", "--frames", "0:8")
    results.call("map", "taught", "-o", "map", "--trajectory", "map.tum")
    results.add_made("map.tum", "map")


def rig(results: Results) -> None:
    """A simulated street stitched from six cameras and mapped; the map as cloud and graph."""
    demo = results.demo()
    results.call("map", demo / "teach", "-o", "map", "--rig", demo / "rig.yaml", "--taught", "taught.tum")
    for name in ("graph.g2o", "town.ply"):
        results.call("map-export", "map", "-o", name)
    results.add_made("taught.tum", "map", "graph.g2o", "town.ply")


def localize(results: Results) -> None:
    """One camera localised in the map of the street, and found in its bare cloud."""
    demo = results.demo()
    results.call("localize", demo / "map", demo / "teach", "-o", "poses.tum", "--bag", "bag", *FRONT)
    results.call("map-export", demo / "map", "-o", "town.ply")
    results.call("mcl", "town.ply", demo / "teach", "-o", "mcl.tum", "--bag", "mcl", *FRONT)
    results.add_made("poses.tum", "bag", "mcl.tum", "mcl")


def commands(results: Results) -> None:
    """A recorded drive through path_follower, as an operator would use it: poses and states in, commands out."""
    from path_follower.ros.node import PathFollowerNode
    from sphere_nav.ros.bags.reader import BagReader
    from sphere_nav.ros.bags.replay import OfflineBus, replay

    demo = results.demo()
    for source in ("pose", "odometry"):
        bus = OfflineBus()
        values = {"trajectory": str(demo / "taught.tum"), "enable_stamped_cmd_vel": True, "source": source}
        node: Any = bus.add(PathFollowerNode, values)
        shell = getattr(node, "shell", node.endpoints)  # where a revision that is compared still has both
        published, num_told, asked_ns = [], -1, -1
        with BagReader(demo / "drive") as reader:
            for item in replay(reader, bus):
                kind = type(item.message)
                published.append((item.topic, f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}", item.message))
                if item.topic == "/path_follower/status" and item.stamp_ns > asked_ns:
                    if num_told >= 0 or shell.call("start").success:
                        num_told += 1
                    if num_told in CALLS:
                        shell.call(CALLS[num_told])
                    asked_ns = item.stamp_ns  # each call is answered by a status of the same time
        if num_told < 0:
            raise RuntimeError("path_follower: expected a start, found it refused to the end")
        results.add_messages(f"by {source}", published)


def calibrate(results: Results) -> None:
    """A stereo pair calibrated by images of a board."""
    images = [results.recorded("checkerboard/opencv_stereo") / f"{name}*.jpg" for name in ("left", "right")]
    results.call("calibrate", *images, "--board", "9x6", "--square", "0.025", "-o", "rig.yaml")
    results.add_made("rig.yaml")


CASES: dict[str, Callable[[Results], None]] = {
    case.__name__: case for case in (kitchen, stereo, rig, localize, commands, calibrate)
}


def record(arguments: argparse.Namespace) -> int:
    """Run the cases, write what they gave; 1 where one failed."""
    cases: dict[str, Any] = {}
    for name in arguments.only or CASES:
        begun = time.monotonic()
        with tempfile.TemporaryDirectory(prefix="compare_results_") as scratch:
            results = Results(Path(scratch), arguments.inputs.absolute(), arguments.data.absolute())
            try:
                CASES[name](results)
                cases[name] = {"digests": results.digests}
            except Skipped as reason:
                cases[name] = {"skipped": str(reason)}
            except (OSError, RuntimeError, subprocess.TimeoutExpired) as error:
                cases[name] = {"failed": str(error)}
        told = cases[name].get("skipped") or cases[name].get("failed") or f"{len(results.digests)} digests"
        sys.stdout.write(f"{name:<10} {time.monotonic() - begun:6.1f} s  {told}\n")
    made = arguments.inputs / "demo" / "result.json"
    found = {"inputs": made.read_text(encoding="utf-8") if made.is_file() else "", "cases": cases}
    arguments.output.write_text(json.dumps(found, indent=1), encoding="utf-8")
    return int(any("failed" in case for case in cases.values()))


def differences(before: Mapping[str, Any], after: Mapping[str, Any], ignored: Sequence[str] = ()) -> list[list[str]]:
    """Return what differs between two records as rows of case, what, before and after, but for patterns of `case what`.

    A digest or a case that only one side has is a difference, and so is a case that failed, even on both sides.
    """
    rows = [["inputs", "demo", "one", "another"]] if before["inputs"] != after["inputs"] else []
    for name in before["cases"] | after["cases"]:
        sides = [side["cases"].get(name, {"failed": "not recorded"}) for side in (before, after)]
        told = [next((f"{word}: {side[word]}" for word in ("failed", "skipped") if word in side), "") for side in sides]
        if told[0] != told[1] or told[0].startswith("failed"):
            rows.append([name, "", *(text or "done" for text in told)])
            continue
        digests = [side.get("digests", {}) for side in sides]
        for what in digests[0] | digests[1]:
            found = [side.get(what, "none")[:12] for side in digests]
            if found[0] != found[1] and not any(fnmatch(f"{name} {what}", pattern) for pattern in ignored):
                rows.append([name, what, *found])
    return rows


def read_record(path: Path, only: Sequence[str]) -> dict[str, Any]:
    """Return what `record` wrote of some cases, or all; ValueError where that is something else."""
    try:
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        cases = {name: dict(case) for name, case in found["cases"].items() if not only or name in only}
        return {"inputs": str(found["inputs"]), "cases": cases}
    except (OSError, ValueError, TypeError, LookupError, AttributeError) as error:
        raise ValueError(f"{path}: expected a record of this script, found: {error}") from None


def compare(arguments: argparse.Namespace) -> int:
    """Print what differs; 1 where anything does, or nothing was compared."""
    before, after = (read_record(path, arguments.only) for path in (arguments.before, arguments.after))
    rows = differences(before, after, arguments.ignore)
    num_digests = sum(len(case.get("digests", ())) for case in before["cases"].values())
    verdict = f"equal, bit for bit ({num_digests} digests)" if num_digests else "NOTHING COMPARED"
    sys.stdout.writelines(f"{line}\n" for line in [*map(" | ".join, rows), "NOT EQUAL" if rows else verdict])
    return int(bool(rows) or not num_digests)


def main(words: Sequence[str] | None = None) -> int:
    """Record or compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", choices=CASES, default=[], metavar="CASE", help=", ".join(CASES))
    todo = parser.add_subparsers(required=True)
    recording = todo.add_parser("record", help="run the cases with one version")
    recording.set_defaults(run=record)
    recording.add_argument("-o", "--output", type=Path, required=True, metavar="FILE")
    recording.add_argument("--inputs", type=Path, default=Path("out/compare_inputs"), help="(%(default)s)")
    recording.add_argument("--data", type=Path, default=Path("../shared/data"), help="recorded data (%(default)s)")
    comparing = todo.add_parser("compare", help="tell what differs between two records")
    comparing.set_defaults(run=compare)
    for name in ("before", "after"):
        comparing.add_argument(name, type=Path)
    comparing.add_argument("--ignore", action="append", default=[], metavar="PATTERN", help="of 'CASE WHAT'")
    arguments = parser.parse_args(words)
    try:
        return int(arguments.run(arguments))
    except ValueError as error:
        sys.stderr.write(f"compare_results.py: {error}\n")
        return 2


if __name__ == "__main__":
    sys.exit(main())
