"""Optima of published pose graphs, and of made ones whose odometry leads into wrong valleys."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from benchmarks.mapping.graphs.graph_file import read_graph
from benchmarks.mapping.graphs.optimum import Certified, optimize
from benchmarks.pose_graph_worlds import sphere, torus
from benchmarks.report import Bound, Report, Table
from sphere_mapping.graph.factors import factors_of, minimize_poses
from sphere_mapping.graph.pose_graph import PoseGraph

HELP = "optima of pose graphs against published ones; torus and noisy sphere made from seeds"
PUBLISHED = {  # SE-Sync's cost; GTSAM's chi2 with full information where it is known
    "tinyGrid3D": (18.520, 18.628),
    "smallGrid3D": (1025.50, 1035.85),
    "sphere2500": (1687.0, 1351.40),
    "parking-garage": (1.2625, 1.26839),
    "intel": (52.35, None),
    "manhattan": (6431.4, None),
}
SIGMAS = {"torus": (0.3, 0.15), "noisy sphere": (0.5, 0.2)}  # m, rad of each axis of an edge
FOLDER = Path("../shared/data/pose_graphs")


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Declare the arguments."""
    parser.add_argument("--graphs", type=Path, default=FOLDER, metavar="DIR", help="published graphs (%(default)s)")
    parser.add_argument("--graph-seeds", type=int, nargs="+", default=[1, 2, 3], help="of made graphs (1 2 3)")


def run(options: argparse.Namespace) -> Report:
    """Optimise all of them."""
    report = Report("pose_graphs")
    report.tables += [_published(options.graphs, report), _made(options, report)]
    return report


def _published(folder: Path, report: Report) -> Table:
    rows = []
    for name, (cost, chi2) in PUBLISHED.items():
        path = folder / f"{name}.g2o"
        if not path.is_file():
            report.notes.append(f"{path}: not there")
            continue
        graph = read_graph(path)
        found, seconds = _timed(graph)
        reached = found.certificate.cost
        report.bounds.append(Bound(f"{name}: cost above the published one", 0.1, 100 * (reached / cost - 1), "%"))
        if chi2 is not None:
            report.bounds.append(
                Bound(f"{name}: chi2 above the published one", 0.1, 100 * (found.chi2_after / chi2 - 1), "%")
            )
        rows.append(
            (
                name,
                str(len(graph.ids)),
                f"{reached:.6g}",
                f"{cost:.6g}",
                *_chi2(found),
                _told(found),
                f"{seconds:.1f} s",
            )
        )
    columns = ("graph", "poses", "cost of SE-Sync", "published", "chi2 before", "chi2 after", "certified", "CPU")
    return Table("Published graphs", columns, rows)


def _made(options: argparse.Namespace, report: Report) -> Table:
    rows = []
    size = (20, 20) if options.quick else (50, 50)
    for name, make in (("torus", torus), ("noisy sphere", sphere)):
        for seed in options.graph_seeds:
            graph = make(*size, SIGMAS[name], seed)
            found, seconds = _timed(graph)
            from_odometry = minimize_poses(factors_of(graph), graph, graph.poses)
            freedom = 6 * (len(graph.ends) - len(graph.ids) + 1)
            report.bounds.append(
                Bound(f"{name} {seed}: chi2 per degree of freedom", 1.1, found.chi2_after / freedom, "")
            )
            alone = "broke down" if from_odometry is None else f"{from_odometry.chi2:.6g}"
            rows.append((name, str(seed), str(freedom), *_chi2(found), alone, _told(found), f"{seconds:.1f} s"))
    columns = ("graph", "seed", "freedom", "chi2 before", "chi2 after", "from odometry", "certified", "CPU")
    return Table("Made graphs", columns, rows)


def _timed(graph: PoseGraph) -> tuple[Certified, float]:
    start = time.process_time()
    return optimize(graph), time.process_time() - start


def _chi2(found: Certified) -> tuple[str, str]:
    return f"{found.chi2_before:.6g}", f"{found.chi2_after:.6g}"


def _told(found: Certified) -> str:
    return "yes" if found.certificate.is_global else "no"
