"""`sphere_nav optimize`: a pose graph of anybody's at the poses that fit its edges best."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from tqdm import tqdm

from sphere_mapping.graph.graph_file import read_graph, write_g2o
from sphere_mapping.graph.optimum import Optimum, optimize
from sphere_mapping.graph.pose_graph import PoseGraph

HELP = """\
Optimise a pose graph: g2o (VERTEX_SE3:QUAT, VERTEX_SE2) or TORO (VERTEX3, VERTEX2), with its vertices or without.

The descent starts from the chordal solution, not from the file's poses, however bad these are. chi2 is the sum of
e' Information e over all edges, e = log(T_measured^-1 T_a^-1 T_b). A certificate tells whether a better optimum can
exist; where there is none, a warning says so. The vertex that FIX names, else the first, of each connected part stays
where it is.

examples:
  sphere_nav optimize sphere2500.g2o -o optimised.g2o
  sphere_nav optimize manhattan.g2o -o optimised.g2o --json report.json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("graph", type=Path, metavar="GRAPH", help="g2o or TORO file")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help="g2o file to write")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there")


def run(arguments: argparse.Namespace) -> int:
    """Read, optimise, write, tell."""
    if arguments.output.exists() and arguments.output.samefile(arguments.graph):
        raise ValueError(f"--output: expected another file than the graph, found {arguments.output}")
    graph = read_graph(arguments.graph)
    with tqdm(desc=f"optimise {len(graph.ids)} poses", bar_format="{desc} {elapsed}", leave=False, disable=None):
        try:
            found = optimize(graph)
        except ValueError as error:
            raise ValueError(f"{arguments.graph}: {error}") from None
    partial = arguments.output.with_name(arguments.output.name + ".part")
    write_g2o(partial, replace(graph, poses=found.poses))
    partial.replace(arguments.output)
    report = optimum_as_mapping(graph, found)
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    print(f"{len(graph.ids)} vertices, {len(graph.ends)} edges, {len(graph.anchors)} connected")
    print(f"chi2_before: {found.chi2_before:.8g}")
    print(f"chi2_after: {found.chi2_after:.8g}")
    print(f"iterations: {found.iterations}")
    if found.doubt:
        print(f"warning: {arguments.graph}: {found.doubt}")
    return 0


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
