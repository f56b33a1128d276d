"""What is left is closed: no thread and no open file of it remains, whatever ended it."""

from __future__ import annotations

import os
import threading
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from std_msgs.msg import String

from dense_localizer.references.reference import SpherePrefetch
from sphere_nav.geometry import SE3, Pinhole, Spherical
from sphere_nav.ros.bags import BagReader, BagWriter
from sphere_nav.ros.maps.reader import open_map
from sphere_nav.ros.maps.writer import save_map
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere
from sphere_nav.view_synthesis.scene import Scene
from worlds.localizer import MemoryMap

CAMERA = Spherical(64, 32)
GRAPH = SphereGraph(
    KeySphere(k, k + 1, SE3.from_planar(k, 0.0, 0.0),
              Sphere(np.full((32, 64), 90 + k, np.uint8), np.full((32, 64), 2.0, np.float32), CAMERA, k + 1))
    for k in range(2)
)  # fmt: skip


def bag(folder: Path) -> BagWriter:
    writer = BagWriter(folder / "bag")
    writer.add_topic("text", String)
    writer.write("text", String(data="one"), 1)
    return writer


def read_bag(folder: Path) -> BagReader:
    with bag(folder):
        pass
    reader = BagReader(folder / "bag")
    assert len(list(reader.messages(["text"]))) == 1
    return reader


def read_map(folder: Path) -> Any:
    reader = open_map(save_map(folder / "map", GRAPH))
    assert reader.load_sphere(1).camera == CAMERA
    return reader


def scene(folder: Path) -> Scene:
    scene = Scene(MemoryMap(GRAPH))
    scene.render(SE3.identity(), Pinhole(32, 24, 30.0, 30.0, 15.5, 11.5))
    return scene


def prefetch(folder: Path) -> SpherePrefetch:
    prefetch = SpherePrefetch(lambda sphere_id: SimpleNamespace(num_bytes=1), 1e6, is_live=True)
    prefetch.get(1)
    return prefetch


OPENED = {open_.__name__: open_ for open_ in (bag, read_bag, read_map, scene, prefetch)}


def held() -> tuple[set[str], set[int | None]]:
    files = set()
    for number in os.listdir("/proc/self/fd"):
        with suppress(OSError):
            files.add(os.readlink(f"/proc/self/fd/{number}"))
    return {name for name in files if name.startswith("/")}, {one.ident for one in threading.enumerate()}


@pytest.mark.parametrize("name", OPENED)
def test_what_a_node_has_left_holds_neither_a_file_nor_a_thread(tmp_path: Path, name: str) -> None:
    before = held()
    opened = OPENED[name](tmp_path)
    assert held() != before
    opened.close()
    assert [now - then for now, then in zip(held(), before, strict=True)] == [set(), set()]


@pytest.mark.parametrize("name", ["bag", "read_bag", "read_map"])
def test_an_error_within_a_block_leaves_nothing_open_and_is_told(tmp_path: Path, name: str) -> None:
    before = held()
    with pytest.raises(KeyError, match="meanwhile"), OPENED[name](tmp_path):
        raise KeyError("meanwhile")
    assert [now - then for now, then in zip(held(), before, strict=True)] == [set(), set()]
