"""Presets of camera drivers, `config/cameras/NAME.yaml`: under which names a driver tells what we call image_raw, ...

A file of the same form is as good as a name. Its topics are relative to `root`, the driver's own namespace, and that
to the namespace of the node.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sphere_nav.geometry.files.untrusted import MAX_FILE_BYTES, choice, load_yaml, read_as, read_text, required, short
from sphere_nav.ros.shared_files import share_file

FOLDER, ANY_FILE = "config/cameras", "usb_cam"  # a file that is always there
INPUTS = ("rgbd", "stereo", "mono", "panorama")


@dataclass(frozen=True)
class Driver:
    """What a driver publishes, as far as it is of use here."""

    name: str
    title: str
    source: str  # where it was looked up
    input: str  # one of INPUTS
    root: str
    topics: dict[str, str]  # our name -> the driver's, relative to root
    encodings: dict[str, tuple[str, ...]]  # of images, by our name

    def names(self) -> dict[str, str]:
        """Return the driver's topic for each of ours."""
        return {ours: f"{self.root}/{theirs}".lstrip("/") for ours, theirs in self.topics.items()}


def driver_names() -> list[str]:
    """Return the names of the presets that are installed."""
    return sorted(path.stem for path in share_file(f"{FOLDER}/{ANY_FILE}.yaml").parent.glob("*.yaml"))


def read_driver(name: str) -> Driver:
    """Return a preset by its name, or from a file; ValueError: unknown, or not of the form."""
    if not name.endswith(".yaml") and name not in driver_names():
        raise ValueError(f"driver: expected one of {', '.join(driver_names())} or a .yaml file, found {short(name)}")
    path = Path(name) if name.endswith(".yaml") else share_file(f"{FOLDER}/{name}.yaml")
    return _driver(path, load_yaml(path, read_text(path, "driver preset", MAX_FILE_BYTES)))


def topics_by_driver(driver: str) -> dict[str, str]:
    """Return the driver's topic for each of ours, relative to the node's namespace; none without a driver."""
    return read_driver(driver).names() if driver else {}


def _driver(path: Path, content: Any) -> Driver:
    driver: Driver = read_as(Driver, {"name": path.stem, **required(content, str(path), ())}, str(path))
    choice(driver.input, f"{path}: input", INPUTS)
    topics = {ours: theirs.strip("/") for ours, theirs in driver.topics.items()}
    return replace(driver, root=driver.root.strip("/"), topics=topics)
