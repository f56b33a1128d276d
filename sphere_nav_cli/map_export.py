"""`sphere_nav map-export`: a map as point cloud, pose graph or trajectory."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from node_kit.map_bag import MapReader, open_map
from sphere_geometry import SE3
from sphere_geometry.trajectory import Trajectory, write_tum
from sphere_map.graph import Edge, SphereGraph
from sphere_mapping.graph.map_cloud import points_of
from sphere_mapping.params import CloudParams

HELP = """\
Write a map in a format that other tools read; the suffix of the output says which.

  .ply  point cloud with colours, map frame, metres (binary)
  .g2o  pose graph, VERTEX_SE3:QUAT and EDGE_SE3:QUAT
  .tum  pose of every key sphere: stamp x y z qx qy qz qw
  .kitti  the same without stamps: the first three rows of T_map_sphere

examples:
  sphere_nav map-export kitchen_map -o kitchen.ply --step 4
  sphere_nav map-export kitchen_map -o kitchen.g2o
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("map", type=Path, metavar="MAP", help="a map (a folder)")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help="file to write")
    parser.add_argument("--step", type=int, default=4, help=".ply: every how many rows and columns (%(default)s)")
    parser.add_argument("--max-range", type=float, default=50.0, metavar="M", help=".ply: farther is left out")


def run(arguments: argparse.Namespace) -> int:
    """Write the file."""
    output: Path = arguments.output
    if output.suffix not in WRITERS:
        raise ValueError(f"{output}: expected a suffix of {', '.join(WRITERS)}, found {output.suffix or 'none'!r}")
    cloud = CloudParams(step=arguments.step, max_range_m=arguments.max_range)
    partial = output.with_name(output.name + ".part")
    with open_map(arguments.map) as reader:
        count = WRITERS[output.suffix](reader, partial, cloud)
    partial.replace(output)
    print(f"{output}: {count}")
    return 0


def write_ply(reader: MapReader, path: Path, params: CloudParams) -> str:
    """Write the points of all key spheres; return what was written, in words."""
    kind = [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1")]
    parts = []
    for node in tqdm(list(reader.graph), desc="export", unit="sphere", leave=False, disable=None):
        points, values = points_of(replace(node, sphere=reader.load_sphere(node.id)), params)
        table = np.zeros(len(points), dtype=kind)
        for axis, name in enumerate("xyz"):
            table[name] = points[:, axis]
        rgb = np.broadcast_to(values.reshape(len(points), -1), (len(points), 3))
        for channel, name in enumerate(("red", "green", "blue")):
            table[name] = rgb[:, channel]
        parts.append(table)
    cloud = np.concatenate(parts)
    names = {"<f4": "float", "u1": "uchar"}
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(cloud)}"]
    head += [f"property {names[code]} {name}" for name, code in kind] + ["end_header"]
    path.write_bytes(("\n".join(head) + "\n").encode() + cloud.tobytes())
    return f"{len(cloud)} points"


def write_g2o(reader: MapReader, path: Path, _: CloudParams) -> str:
    """Write the graph."""
    path.write_text(g2o_text(reader.graph), encoding="ascii")
    return f"{len(reader.graph)} vertices, {len(reader.graph.edges)} edges"


def g2o_text(graph: SphereGraph) -> str:
    """Return the graph as g2o: information of (translation, rotation vector), as `optimize` and GTSAM read it."""
    nodes = sorted(graph, key=lambda node: node.id)
    lines = [f"VERTEX_SE3:QUAT {node.id} {_numbers(node.T_map_sphere)}" for node in nodes]
    return "\n".join(lines + [_edge(edge) for edge in graph.edges]) + "\n"


def write_trajectory(reader: MapReader, path: Path, _: CloudParams) -> str:
    """Write the poses of the key spheres by stamp."""
    nodes = sorted(reader.graph, key=lambda node: node.stamp_ns)
    matrices = np.stack([node.T_map_sphere.matrix for node in nodes])
    write_tum(path, Trajectory(np.array([node.stamp_ns for node in nodes], dtype=np.int64), SE3(matrices)))
    return f"{len(nodes)} poses"


def write_kitti(reader: MapReader, path: Path, _: CloudParams) -> str:
    """Write the poses of the key spheres by stamp, a line of 12 numbers each."""
    nodes = sorted(reader.graph, key=lambda node: node.stamp_ns)
    np.savetxt(path, [node.T_map_sphere.matrix[:3].ravel() for node in nodes], fmt="%.9g")
    return f"{len(nodes)} poses"


def _edge(edge: Edge) -> str:
    triangle = " ".join(f"{value:.9g}" for value in edge.information[np.triu_indices(6)])
    return f"EDGE_SE3:QUAT {edge.a} {edge.b} {_numbers(edge.T_a_b)} {triangle}"


def _numbers(T: SE3) -> str:
    return " ".join(f"{value:.9f}" for value in (*T.translation, *T.quaternion))


WRITERS: dict[str, Callable[[MapReader, Path, CloudParams], str]] = {
    ".ply": write_ply,
    ".g2o": write_g2o,
    ".tum": write_trajectory,
    ".kitti": write_kitti,
}
