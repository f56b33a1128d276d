"""False loops in pose graphs: is the optimum of the true loops found, and what does it cost?"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.mapping.graphs.graph_file import read_graph
from benchmarks.mapping.graphs.optimum import edge_chi2, optimize
from benchmarks.mapping.graphs.outliers import loops_of, optimize_robustly
from benchmarks.pose_graph_worlds import sphere, torus
from benchmarks.report import Bound, Report, Table
from sphere_mapping.graph.pose_graph import PoseGraph

HELP = "false loops among those of public or made pose graphs: chi2 of the true edges beside their optimum"
PUBLIC = ("sphere2500", "parking-garage", "intel", "manhattan", "smallGrid3D")
SHARES = (0.1, 0.3, 0.5)  # of all loops that are false
GROUP = 5  # false loops in a row that agree with one another, as where one street looks like another
KINDS = ("single", "grouped")
MAX_ABOVE = 1.0  # percent of the optimum of the true edges
MADE = {"made torus": (torus, (20, 20)), "made sphere": (sphere, (20, 20))}
MADE_SIGMAS = (0.05, 0.02)  # m, rad of each axis of an edge


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments; the folder of public graphs is that of `pose_graphs`."""
    parser.add_argument("--loop-graphs", nargs="*", metavar="NAME|FILE", help="public graphs, files, made ones (all)")
    parser.add_argument("--loop-shares", type=float, nargs="+", default=SHARES, help="of false loops (0.1 0.3 0.5)")
    parser.add_argument("--loop-seeds", type=int, nargs="+", default=[11], help="of false loops (11)")
    parser.add_argument("--loop-kinds", nargs="+", choices=KINDS, default=list(KINDS), help="of false loops (both)")


def run(options: argparse.Namespace) -> Report:
    """Add false loops and take them away again."""
    report, rows = Report("outlier_loops"), []
    for name in options.loop_graphs or [*PUBLIC, *MADE]:
        graph = _graph(name, options.graphs, options.loop_seeds[0])
        if graph is None:
            report.notes.append(f"{name}: no such file in {options.graphs}")
            continue
        clean = optimize(graph).chi2_after
        for kind in options.loop_kinds:
            found = [
                _trial(graph, clean, share, kind, seed)
                for share in (options.loop_shares[:1] if options.quick else options.loop_shares)
                for seed in options.loop_seeds
            ]
            rows += [(name, kind, *cells) for _, cells in found]
            worst = max(above for above, _ in found)
            report.bounds.append(Bound(f"{name}, {kind}: chi2 above the clean optimum", MAX_ABOVE, worst, "%"))
    columns = ("graph", "kind", "share", "seed", "false", "kept false", "lost true", "chi2 above clean", "CPU")
    report.tables.append(Table("False loops", columns, rows))
    return report


def with_false_loops(graph: PoseGraph, share: float, kind: str, seed: int) -> PoseGraph:
    """Return the graph with false loops at the end, so many that they are a share of all loops.

    Each has motion and information of a true loop, between two poses by chance; of a group, between the next poses as
    the next true loops have them.
    """
    rng, loops = np.random.default_rng([seed, 41]), np.flatnonzero(loops_of(graph))
    count = round(share / (1 - share) * len(loops))
    size = GROUP if kind == "grouped" else 1
    ends: list[tuple[int, int]] = []
    sources: list[int] = []
    while len(ends) < count:
        a, b = np.sort(rng.integers(len(graph.ids) - size, size=2))
        first = rng.integers(len(loops) - size)
        if b - a > GROUP:
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


def _trial(graph: PoseGraph, clean: float, share: float, kind: str, seed: int) -> tuple[float, tuple[str, ...]]:
    spoiled, start = with_false_loops(graph, share, kind, seed), time.process_time()
    found = optimize_robustly(spoiled)
    seconds, count = time.process_time() - start, len(graph.ends)
    above = 100 * (float(edge_chi2(graph, found.optimum.poses).sum()) / clean - 1)
    is_false = np.arange(len(spoiled.ends)) >= count
    kept, lost = np.count_nonzero(is_false & ~found.is_outlier), np.count_nonzero(~is_false & found.is_outlier)
    cells = (f"{share:.0%}", str(seed), str(len(spoiled.ends) - count), str(kept), str(lost))
    return above, (*cells, f"{above:.3f} %", f"{seconds:.1f} s")


def _graph(name: str, folder: Path, seed: int) -> PoseGraph | None:
    if name in MADE:
        make, size = MADE[name]
        return make(*size, MADE_SIGMAS, seed)
    path = Path(name) if name.endswith((".g2o", ".toro", ".graph")) else folder / f"{name}.g2o"
    return read_graph(path) if path.is_file() else None
