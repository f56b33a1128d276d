"""Optima of published pose graphs and of made ones, as they are and with false loops among their own.

Published: the cost beside that of SE-Sync, chi2 beside GTSAM's. Made: odometry that leads into wrong valleys. False
loops have motion and information of true ones, between two poses by chance; those of a group agree with one another, as
where one street looks like another. Judged is chi2 of the true edges, beside their optimum.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from benchmarks.mapping.graphs.certificate import Certified, optimize
from benchmarks.mapping.graphs.graph_file import read_graph
from benchmarks.mapping.graphs.made import sphere, torus
from benchmarks.mapping.graphs.outliers import edge_chi2, loops_of, optimize_robustly
from benchmarks.report import Bound, Headline, Report, Table
from sphere_mapping.graph.pose_graph import PoseGraph

HELP = "optima of published and made pose graphs, certified; false loops among theirs found"
PUBLISHED = {  # SE-Sync's cost; GTSAM's chi2 with full information where it is known
    "tinyGrid3D": (18.520, 18.628),
    "smallGrid3D": (1025.50, 1035.85),
    "parking-garage": (1.2625, 1.26839),
    "intel": (52.35, None),
    "sphere2500": (1687.0, 1351.40),
    "manhattan": (6431.4, None),
}
QUICK = ("tinyGrid3D", "smallGrid3D", "parking-garage")
MADE = {"torus": (torus, (0.3, 0.15)), "noisy sphere": (sphere, (0.5, 0.2))}  # m, rad of each axis of an edge
SPOILED = ("smallGrid3D", "parking-garage", "intel", "sphere2500", "manhattan")
SPOILED_SIGMAS = (0.05, 0.02)  # of made graphs with false loops
SHARES = (0.1, 0.3, 0.5)  # of all loops that are false
GROUPS = {"single": 1, "grouped": 5}  # false loops in a row that agree with one another
MIN_APART = 5  # poses between the ends of a false loop


def run(options: argparse.Namespace) -> Report:
    """Optimise all of them, then take false loops away."""
    report, folder = Report("pose_graphs", notes=[__doc__ or ""]), options.data / "pose_graphs"
    is_quick = options.size == "quick"
    published = {
        name: read_graph(folder / f"{name}.g2o")
        for name in (QUICK if is_quick else PUBLISHED)
        if (folder / f"{name}.g2o").is_file()
    }
    size, seeds = ((20, 20), 1) if is_quick else ((50, 50), 3)
    rows = [_published(name, graph, report) for name, graph in published.items()]
    rows += [_made(name, size, seed, report) for name in MADE for seed in range(options.seed, options.seed + seeds)]
    columns = ("graph", "poses", "cost of SE-Sync", "published", "chi2 before", "chi2 after", "best there is", "CPU s")
    report.tables.append(Table("Optima", columns, rows))
    spoiled = {name: graph for name, graph in published.items() if name in SPOILED[: 1 if is_quick else None]}
    if not is_quick:
        spoiled |= {f"made {name}": MADE[name][0](20, 20, SPOILED_SIGMAS, options.seed) for name in MADE}
    rows = [row for name, graph in spoiled.items() for row in _spoiled(name, graph, options, report)]
    columns = ("graph", "kind", "share", "false", "kept false", "lost true", "chi2 above clean %", "CPU s")
    report.tables.append(Table("False loops", columns, rows))
    return report


def _published(name: str, graph: PoseGraph, report: Report) -> tuple[str, ...]:
    found, seconds = _timed(graph)
    cost, chi2 = PUBLISHED[name]
    above = 100 * (found.cost / cost - 1)
    told = Headline("map", name, f"{cost:g} (SE-Sync)") if name == "parking-garage" else None
    report.bounds.append(Bound(f"{name}: cost above the published one", 0.1, above, "%", headline=told))
    if chi2 is not None:
        report.bounds.append(Bound(f"{name}: chi2 above GTSAM's", 0.1, 100 * (found.chi2_after / chi2 - 1), "%"))
    return (name, str(len(graph.ids)), f"{found.cost:.6g}", f"{cost:.6g}", *_cells(found, seconds))


def _made(name: str, size: tuple[int, int], seed: int, report: Report) -> tuple[str, ...]:
    make, sigmas = MADE[name]
    graph = make(*size, sigmas, seed)
    found, seconds = _timed(graph)
    freedom = 6 * (len(graph.ends) - len(graph.ids) + 1)
    report.bounds.append(Bound(f"{name} {seed}: chi2 by its freedom", 1.1, found.chi2_after / freedom, ""))
    return (f"{name} {seed}", str(len(graph.ids)), f"{found.cost:.6g}", "", *_cells(found, seconds))


def _timed(graph: PoseGraph) -> tuple[Certified, float]:
    start = time.process_time()
    return optimize(graph), time.process_time() - start


def _cells(found: Certified, seconds: float) -> tuple[str, ...]:
    chi2 = (f"{found.chi2_before:.6g}", f"{found.chi2_after:.6g}")
    return (*chi2, "certified" if found.is_global else "unknown", f"{seconds:.1f}")


def _spoiled(name: str, graph: PoseGraph, options: argparse.Namespace, report: Report) -> list[tuple[str, ...]]:
    clean, rows = optimize(graph).chi2_after, []
    for kind in GROUPS:
        worst = -np.inf
        for share in SHARES[1:2] if options.size == "quick" else SHARES:
            spoiled, start = with_false_loops(graph, share, GROUPS[kind], options.seed), time.process_time()
            found = optimize_robustly(spoiled)
            seconds = time.process_time() - start
            above = 100 * (float(edge_chi2(graph, found.optimum.poses).sum()) / clean - 1)
            is_false = np.arange(len(spoiled.ends)) >= len(graph.ends)
            counts = [is_false, is_false & ~found.is_outlier, ~is_false & found.is_outlier]
            told = (str(np.count_nonzero(one)) for one in counts)
            rows.append((name, kind, f"{share:.0%}", *told, f"{above:.3f}", f"{seconds:.1f}"))
            worst = max(worst, above)
        report.bounds.append(Bound(f"{name}, {kind} false loops: chi2 above the clean optimum", 1.0, worst, "%"))
    return rows


def with_false_loops(graph: PoseGraph, share: float, size: int, seed: int) -> PoseGraph:
    """Return the graph with false loops at the end, `size` in a row, so many that they are a share of all loops."""
    rng, loops = np.random.default_rng([seed, 41]), np.flatnonzero(loops_of(graph))
    count = round(share / (1 - share) * len(loops))
    ends: list[tuple[int, int]] = []
    sources: list[int] = []
    while len(ends) < count:
        a, b = np.sort(rng.integers(len(graph.ids) - size, size=2))
        first = rng.integers(len(loops) - size)
        if b - a > MIN_APART:
            ends += [(a + k, b + k) for k in range(size)]
            sources += [int(loops[first + k]) for k in range(size)]
    chosen = np.array(sources[:count], dtype=np.int64)
    return replace(
        graph,
        ends=np.concatenate([graph.ends, np.array(ends[:count], dtype=np.int64).reshape(-1, 2)]),
        motions=np.concatenate([graph.motions, graph.motions[chosen]]),
        information=np.concatenate([graph.information, graph.information[chosen]]),
        is_robust=np.zeros(len(graph.ends) + count, np.bool_),
    )
