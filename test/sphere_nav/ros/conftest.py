"""Bags, maps and nodes for the tests of node_kit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import numpy as np
import pytest
import rclpy
from std_msgs.msg import Header, String

from sphere_nav.geometry import SE3, Spherical
from sphere_nav.ros import qos
from sphere_nav.ros.bags import BagWriter
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere
from worlds.desk import Desk

START = 5_000_000_000
STEP = 100_000_000


@pytest.fixture
def make_bag(tmp_path: Path) -> Callable[..., Path]:
    """Write a bag of numbered strings on /text and headers on /stamp, one chunk a second."""

    def make(name: str = "bag", num: int = 40) -> Path:
        noise = np.random.default_rng(7)
        with BagWriter(tmp_path / name) as bag:
            bag.add_topic("latched", String, qos.LATCHED)
            bag.write("latched", String(data="once"), START)
            for number in range(num):
                stamp = START + number * STEP
                filling = noise.bytes(3000).hex()
                bag.write("text", String(data=f"{number} {filling}"), stamp)
                bag.write("stamp", Header(frame_id=str(number)), stamp + 1)
                if number % 10 == 9:
                    bag.flush()
        return tmp_path / name

    return make


@pytest.fixture
def sphere_graph(rng: np.random.Generator) -> SphereGraph:
    """Three small spheres one metre apart."""
    camera = Spherical(24, 10, 64.0, 20.0, 8.0)
    nodes, edges = [], []
    for number in range(3):
        image = rng.integers(1, 255, (10, 24, 3), dtype=np.uint8)
        range_m = rng.uniform(1.0, 30.0, (10, 24)).astype(np.float32)
        range_m[0], range_m[1] = np.nan, np.inf
        pose = SE3.exp([number, 0.1, 0.0, 0.0, 0.1, 0.3 * number])
        sphere = Sphere(image, range_m, camera, START + number * STEP)
        nodes.append(KeySphere(10 + number, sphere.stamp_ns, pose, sphere))
    for number in range(2):
        root = rng.normal(size=(6, 6))
        T_a_b = nodes[number].T_map_sphere.inverse() @ nodes[number + 1].T_map_sphere
        edges.append(Edge(10 + number, 11 + number, T_a_b, root @ root.T + np.eye(6), is_loop=number == 1))
    return SphereGraph(nodes, edges)


@pytest.fixture
def ros() -> Iterator[None]:
    """An initialised rclpy."""
    rclpy.init()
    yield
    rclpy.try_shutdown()


@pytest.fixture
def open_desk(ros: None) -> Iterator[Callable[..., Desk]]:
    """Open desks that are closed at the end."""
    with ExitStack() as desks:
        yield lambda kind, **values: desks.enter_context(closing(kind(**values)))
