"""Presets of camera drivers, `config/cameras/NAME.yaml`: under which names a driver tells what we call image_raw, ...

A file of the same form is as good as a name. Its topics are relative to `root`, the driver's own namespace, and that
to the namespace of the node.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from sphere_nav.geometry.files.untrusted import MAX_FILE_BYTES, choice, load_yaml, read_as, read_text, required, short
from sphere_nav.ros.endpoints import base_topic
from sphere_nav.ros.shared_files import share_file

FOLDER, ANY_FILE = "config/cameras", "usb_cam"  # a file that is always there
INPUTS = ("rgbd", "stereo", "mono", "panorama")
OPTIONAL = ("odom", "imu")


@dataclass(frozen=True)
class Driver:
    """What a driver publishes, as far as it is of use here."""

    name: str
    title: str
    input: str  # one of INPUTS
    root: str
    topics: dict[str, str]  # our name -> the driver's, relative to root

    def names(self, root: str | None = None) -> dict[str, str]:
        """Return the driver's topic for each of ours, below its usual root or another."""
        start = self.root if root is None else root
        return {ours: f"{start}/{theirs}".lstrip("/") for ours, theirs in self.topics.items()}

    def find(self, offered: Iterable[str], root: str | None = None) -> dict[str, str]:
        """Return the topics that are offered, by ours; compressed ones where only those are."""
        have = {base_topic(topic): topic for topic in sorted(offered, reverse=True)}  # the shortest of each comes last
        return {ours: have[f"/{name}"] for ours, name in self.names(root).items() if f"/{name}" in have}

    def missing(self, offered: Iterable[str], root: str | None = None) -> list[str]:
        """Return the topics that are not offered, odometry and IMU aside."""
        found = self.find(offered, root)
        return [f"/{name}" for ours, name in self.names(root).items() if ours not in (*found, *OPTIONAL)]

    def roots(self, offered: Iterable[str]) -> list[str]:
        """Return the namespaces below which all topics of the driver are offered; its own, where it is one, alone."""
        have = list(offered)
        if not self.missing(have):
            return [self.root]
        first = f"/{next(iter(self.topics.values()))}"
        bases = [base for base in map(base_topic, have) if base.endswith(first)]
        roots = sorted({base.removesuffix(first).lstrip("/") for base in bases})
        return [root for root in roots if not self.missing(have, root)]


def driver_names() -> list[str]:
    """Return the names of the presets that are installed."""
    return sorted(path.stem for path in share_file(f"{FOLDER}/{ANY_FILE}.yaml").parent.glob("*.yaml"))


def read_driver(name: str) -> Driver:
    """Return a preset by its name, or from a file; ValueError: unknown, or not of the form."""
    if not name.endswith(".yaml") and name not in driver_names():
        raise ValueError(f"driver: expected one of {', '.join(driver_names())} or a .yaml file, found {short(name)}")
    path = Path(name) if name.endswith(".yaml") else share_file(f"{FOLDER}/{name}.yaml")
    content = load_yaml(path, read_text(path, "driver preset", MAX_FILE_BYTES))
    driver: Driver = read_as(Driver, {"name": path.stem, **required(content, str(path), ())}, str(path))
    choice(driver.input, f"{path}: input", INPUTS)
    topics = {ours: theirs.strip("/") for ours, theirs in driver.topics.items()}
    return replace(driver, root=driver.root.strip("/"), topics=topics)


def topics_by_driver(driver: str) -> dict[str, str]:
    """Return the driver's topic for each of ours, relative to the node's namespace; none without a driver."""
    return read_driver(driver).names() if driver else {}
