"""What a key sphere costs in maps of 100, 1,000 and 10,000: memory, time to add, to look up, to write, to adjust.

The spheres are synthetic and small (64 x 32). Their features are drawn from a town's worth of descriptors, with noise,
300 a sphere; they stand a metre apart on a way that comes back to itself, with a loop to an older sphere every tenth.
The graph is adjusted after each loop, as when it grows. Times are CPU of one thread, those of adding and writing of the
last hundred spheres, those of a loop of the last twenty; "in all" is what one key sphere costs beside its alignment and
stitching, which know nothing of the map's size and are in `mapping_times`.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Bound, Headline, Report, Table
from sphere_mapping.graph.incremental import IncrementalOptimum
from sphere_mapping.graph.loop_closure import Candidate, choose_candidate
from sphere_mapping.graph.optimum import optimize_map
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.ros.maps.reader import open_map
from sphere_nav.ros.maps.writer import MapWriter
from sphere_nav.spheres.appearance.features import Features
from sphere_nav.spheres.appearance.index import AppearanceIndex
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph
from sphere_nav.spheres.sphere import Sphere

HELP = "maps of 100 to 10,000 key spheres: memory, time to add, look up, write and adjust"
SIZES = {"quick": (100, 1000), "full": (100, 1000, 10_000)}
NUM_FEATURES, NUM_KINDS, NOISE = 300, 20_000, 12.0  # of a sphere; of descriptors in the world; grey levels of bytes
CAMERA, LAP, LOOP_STEP = Spherical(64, 32), 29, 10  # spheres until the way is back where it was; between two loops
INFORMATION, SPREAD = np.diag(np.repeat([1 / 0.01**2, 1 / 0.002**2], 3)), np.repeat([0.01, 0.002], 3)
TAIL, NUM_ASKED = 100, 20
ALL, MEMORY = "a key sphere, in all, ms", "memory of the index, kB a sphere"
PARTS = ("add to the index, ms", "look up, ms", "write, ms", "complete the map, ms a sphere")
LIMITS = dict(zip(PARTS[:3], (60.0, 100.0, 20.0), strict=True))
LIMITS |= {"adjust after a loop, ms": 500.0, "adjust at the end, ms": 10_000.0, ALL: 250.0, MEMORY: 100.0}


def run(options: argparse.Namespace) -> Report:
    """Build maps of all sizes."""
    sizes = SIZES[options.size]
    costs = [measure(size) for size in sizes]
    rows = [(step, *(f"{cost[step]:.1f}" for cost in costs)) for step in costs[0]]
    report, told = Report("map_scaling", notes=[__doc__ or ""]), Headline("times and memory", f"{sizes[-1]:,} spheres")
    report.tables.append(Table("Key spheres", ("CPU, one thread", *(f"{size:,}" for size in sizes)), rows))
    for step, limit in LIMITS.items():
        what, unit = step.rsplit(", ", 1)
        headline = told if step == ALL else None
        report.bounds.append(Bound(f"{sizes[-1]:,} key spheres: {what}", limit, costs[-1][step], unit, False, headline))
    return report


def measure(size: int) -> dict[str, float]:
    """Build a map of so many spheres; return what each step costs."""
    rng = np.random.default_rng([size, 9])
    kinds, index, before = rng.integers(0, 256, (NUM_KINDS, 128), np.uint8), AppearanceIndex(), resident_kb()
    adding = [timed(partial(index.add, k, features_of(k, kinds, rng))) for k in range(size)]
    cost = {MEMORY: (resident_kb() - before) / size, PARTS[0]: float(np.mean(adding[-TAIL:]))}
    asked = [features_of(int(k), kinds, rng) for k in rng.integers(0, size, NUM_ASKED)]
    graph = graph_of(size, rng)
    found = [Candidate(size - 1 - LAP, SE3.identity(), 60)]
    choose_candidate(graph, size - 1, found)  # lengths of edges are measured once
    looking = float(np.mean([timed(partial(index.find, one, 4)) for one in asked]))
    cost[PARTS[1]] = looking + timed(partial(choose_candidate, graph, size - 1, found))
    adjust(graph, cost)
    write(graph, index, cost)
    cost[ALL] = sum(cost[part] for part in PARTS) + cost["adjust after a loop, ms"] / LOOP_STEP
    return cost


def adjust(graph: SphereGraph, cost: dict[str, float]) -> None:
    """Adjust the graph loop by loop as it grows, then by a loop through all of it, then all at once as at its end."""
    chain, loops = ({edge.b: edge for edge in graph.edges if edge.is_loop == is_loop} for is_loop in (False, True))
    optimum, grown, times = IncrementalOptimum(), SphereGraph([graph[0]]), list[float]()
    for newer, edge in chain.items():
        grown.add(KeySphere(newer, newer, grown[edge.a].T_map_sphere @ edge.T_a_b))
        grown.connect(edge)
        if newer in loops:
            begun = time.process_time()
            grown = optimum.with_loop(grown, loops[newer])
            times.append(1e3 * (time.process_time() - begun))
    first, last = graph[0], graph[len(graph) - 1]
    through = Edge(first.id, last.id, first.T_map_sphere.inverse() @ last.T_map_sphere, INFORMATION, is_loop=True)
    cost["adjust after a loop, ms"] = float(np.mean(times[-NUM_ASKED:]))
    cost["adjust after a loop that moves all, ms"] = timed(partial(optimum.with_loop, grown, through))
    cost["adjust at the end, ms"] = timed(partial(optimize_map, graph))


def write(graph: SphereGraph, index: AppearanceIndex, cost: dict[str, float]) -> None:
    """Write the map as it grows, and open it."""
    rng = np.random.default_rng(1)
    with tempfile.TemporaryDirectory() as folder:
        writer, times = MapWriter(Path(folder) / "map"), []
        for node in graph:
            image = rng.integers(1, 256, (CAMERA.height, CAMERA.width), np.uint8)
            sphere = Sphere(image, np.full(image.shape, 5.0, np.float32), CAMERA, node.stamp_ns)
            times.append(timed(partial(writer.add, node, sphere)))
        begun = time.process_time()
        path = writer.finish(graph, appearance=index)
        cost |= {PARTS[2]: float(np.mean(times[-TAIL:])), PARTS[3]: 1e3 * (time.process_time() - begun) / len(graph)}
        cost["file, kB a sphere"] = sum(file.stat().st_size for file in path.iterdir()) * 1e-3 / len(graph)
        cost["open the map, ms a sphere"] = timed(lambda: open_map(path).close()) / len(graph)


def features_of(place: int, kinds: NDArray[np.uint8], rng: np.random.Generator) -> Features:
    """Return what is seen at a place: its own descriptors, with noise, as seen from there."""
    own = np.random.default_rng([place, 10])
    chosen = own.choice(len(kinds), NUM_FEATURES, replace=False)
    rays = own.normal(size=(NUM_FEATURES, 3)).astype(np.float32)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    descriptors = np.clip(np.rint(kinds[chosen] + rng.normal(0, NOISE, (NUM_FEATURES, 128))), 0, 255).astype(np.uint8)
    return Features(rays, np.full(NUM_FEATURES, 8.0, np.float32), descriptors)


def graph_of(size: int, rng: np.random.Generator) -> SphereGraph:
    """Return a way that comes round again and again, as it was measured, with its loops."""
    step, poses, edges = SE3.from_planar(1.0, 0.0, 2 * np.pi / LAP), [SE3.identity()], list[Edge]()
    for k in range(1, size):
        measured = step @ SE3.exp(SPREAD * rng.normal(size=6))
        poses.append(poses[-1] @ measured)
        edges.append(Edge(k - 1, k, measured, INFORMATION))
    for k in range(LAP, size, LOOP_STEP):
        edges.append(Edge(k - LAP, k, SE3.exp(SPREAD * rng.normal(size=6)), INFORMATION, is_loop=True))
    return SphereGraph([KeySphere(k, k, pose) for k, pose in enumerate(poses)], edges)


def timed(function: Callable[[], object]) -> float:
    """Return the CPU milliseconds of a call."""
    begun = time.process_time()
    function()
    return 1e3 * (time.process_time() - begun)


def resident_kb() -> float:
    """Return the memory of this process in kB."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") * 1e-3
