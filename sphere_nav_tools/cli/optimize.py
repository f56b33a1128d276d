"""`sphere_nav optimize`: a pose graph of anybody's at the poses that fit its edges best."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from sphere_mapping.graph.graph_file import read_graph_file, write_g2o
from sphere_mapping.graph.optimum import Optimum, optimize
from sphere_mapping.graph.outliers import RobustOptimum, graph_of_edges, loops_of, optimize_robustly
from sphere_mapping.graph.pose_graph import PoseGraph

HELP = """\
Optimise a pose graph: g2o (VERTEX_SE3:QUAT, VERTEX_SE2) or TORO (VERTEX3, VERTEX2), with its vertices or without.

The descent starts from the chordal solution, not from the file's poses, however bad these are. chi2 is the sum of
e' Information e over all edges, e = log(T_measured^-1 T_a^-1 T_b). A certificate tells whether a better optimum can
exist; where there is none, a warning says so. The vertex that FIX names, else the first, of each connected part stays
where it is.

--robust finds false loops (edges between vertices that are not neighbours in the order of their ids) by graduated
non-convexity and leaves them out of the output; odometry is believed. chi2 is told with and without them. How far is
too far follows from the residuals of loops that agree, so that the scale of the information matrices does not matter.
It is experimental: look at what it leaves out. On some published graphs it keeps false loops or loses true ones
(docs/notes/false_loops.md).

examples:
  sphere_nav optimize sphere2500.g2o -o optimised.g2o
  sphere_nav optimize manhattan.g2o -o optimised.g2o --json report.json
  sphere_nav optimize loops.g2o -o optimised.g2o --robust --outliers false_loops.csv --leave-out-indefinite
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("graph", type=Path, metavar="GRAPH", help="g2o or TORO file")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help="g2o file to write")
    parser.add_argument("--robust", action="store_true", help="find false loops and leave them out")
    parser.add_argument(
        "--outliers", type=Path, metavar="FILE", help="with --robust: write line, a, b, chi2 of false loops"
    )
    parser.add_argument(
        "--leave-out-indefinite",
        action="store_true",
        help="leave out edges whose information matrix is indefinite or singular, and name them",
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there")


def run(arguments: argparse.Namespace) -> int:
    """Read, optimise, write, tell."""
    if arguments.output.exists() and arguments.output.samefile(arguments.graph):
        raise ValueError(f"--output: expected another file than the graph, found {arguments.output}")
    if arguments.outliers is not None and not arguments.robust:
        raise ValueError("--outliers: expected --robust with it, found none")
    try:
        graph, left_out = read_graph_file(arguments.graph, is_leaving_out=arguments.leave_out_indefinite)
    except ValueError as error:
        hint = "; --leave-out-indefinite goes on without" if "information matrix" in str(error) else ""
        raise ValueError(f"{error}{hint}") from None
    with tqdm(desc=f"optimise {len(graph.ids)} poses", bar_format="{desc} {elapsed}", leave=False, disable=None):
        try:
            robust = optimize_robustly(graph) if arguments.robust else None
            found = optimize(graph) if robust is None else robust.optimum
        except ValueError as error:
            raise ValueError(f"{arguments.graph}: {error}") from None
    kept = graph if robust is None else graph_of_edges(graph, ~robust.is_outlier)
    partial = arguments.output.with_name(arguments.output.name + ".part")
    write_g2o(partial, replace(kept, poses=found.poses))
    partial.replace(arguments.output)
    report = optimum_as_mapping(kept, found) | {"left_out": list(left_out)}
    if robust is not None:
        report |= outliers_as_mapping(graph, robust)
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    if arguments.outliers is not None and robust is not None:
        _write_outliers(arguments.outliers, graph, robust)
    print(f"{len(graph.ids)} vertices, {len(kept.ends)} edges, {len(kept.anchors)} connected")
    print(f"chi2_before: {found.chi2_before:.8g}")
    print(f"chi2_after: {found.chi2_after:.8g}")
    if robust is not None:
        print(f"chi2_with_outliers: {robust.chi2.sum():.8g}")
        print(f"outliers: {np.count_nonzero(robust.is_outlier)} of {np.count_nonzero(loops_of(graph))} loops")
    print(f"iterations: {found.iterations}")
    for line in left_out:
        print(f"warning: left out: {line}")
    if found.doubt:
        print(f"warning: {arguments.graph}: {found.doubt}{'' if arguments.robust else ' (false loops? --robust)'}")
    return 0


def outliers_as_mapping(graph: PoseGraph, robust: RobustOptimum) -> dict[str, Any]:
    """Return what was judged false as plain values for JSON; chi2 of all edges at the poses of the kept ones."""
    return {
        "loops": int(np.count_nonzero(loops_of(graph))),
        "outliers": [[int(graph.ids[a]), int(graph.ids[b])] for a, b in graph.ends[robust.is_outlier]],
        "chi2_with_outliers": float(robust.chi2.sum()),
    }


def _write_outliers(path: Path, graph: PoseGraph, robust: RobustOptimum) -> None:
    lines = ["line,a,b,chi2"]
    for k in np.flatnonzero(robust.is_outlier):
        a, b = graph.ids[graph.ends[k]]
        lines.append(f"{graph.lines[k]},{a},{b},{robust.chi2[k]:.8g}")
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def optimum_as_mapping(graph: PoseGraph, found: Optimum) -> dict[str, Any]:
    """Return the figures as plain values for JSON."""
    certificate = found.certificate
    return {
        "vertices": len(graph.ids),
        "edges": len(graph.ends),
        "dimension": graph.dimension,
        "connected_parts": len(graph.anchors),
        "chi2_before": found.chi2_before,
        "chi2_after": found.chi2_after,
        "iterations": found.iterations,
        "start": found.start,
        "chi2_by_start": {name: solution.chi2 for name, solution in found.solutions.items()},
        "chordal_cost": certificate.cost if certificate else None,
        "is_certified": certificate.is_global if certificate else None,
        "doubt": found.doubt,
    }
