"""The commands as a user types them, and what they left behind, for benchmarks that measure through them."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.ros.bags import BagReader
from sphere_nav.ros.conversions import message_to_status, stamp_ns
from sphere_nav.spheres.graph import Edge
from sphere_nav_tools.cli.main import main as sphere_nav
from sphere_nav_tools.offline.evaluation import evaluate_poses

TRUTH = ("ground_truth/pose",)  # of recordings and their bags
COMMAND = "from sphere_nav_tools.cli.main import main; sys.exit(main(sys.argv[1:]))"  # in a process of its own


class Said(NamedTuple):
    """What a command said, and its status."""

    status: int
    out: str
    err: str


def run(*words: object) -> Said:
    """Run a command."""
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        try:
            status = sphere_nav([str(word) for word in words])
        except SystemExit as misuse:  # of argparse, which has written why
            status = int(misuse.code or 0)
    return Said(status, out.getvalue(), err.getvalue())


def call(*words: object) -> str:
    """Run a command and return what it said; ValueError with its last line where it fails."""
    said = run(*words)
    if said.status != 0:
        lines = said.err.strip().splitlines() or [""]
        raise ValueError(f"sphere_nav {words[0]}: expected status 0, found {said.status}: {lines[-1]}")
    return said.out + said.err


def errors(estimate: Trajectory, truth: Trajectory) -> NDArray[np.float64]:
    """Return the distance in m of every pose from the truth at its stamp, of those that have one."""
    return evaluate_poses(estimate, truth).errors.translation_m if len(estimate) else np.full(1, np.nan)


def read_states(said: Path) -> dict[int, tuple[str, str]]:
    """Return state and reason by the stamp of the image, of the bag of what was said."""
    with BagReader(said) as bag:
        found = [(stamp_ns(item.message), message_to_status(item.message)) for item in bag.messages(["/status"])]
    return {stamp: (str(status.state), str(status.reason)) for stamp, status in found}


def num_false(loops: Iterable[Edge], truth: Mapping[int, SE3], most: tuple[float, float]) -> int:
    """Return how many loops are more m or deg off than that, by true poses of their key spheres."""
    off = [(truth[edge.a].inverse() @ truth[edge.b]).distance(edge.T_a_b) for edge in loops]
    return sum(bool(moved > most[0] or turned > np.radians(most[1])) for moved, turned in off)


def drift(travelled: Trajectory, truth: Trajectory, first: int = 0) -> float:
    """Return the error at the end in per cent of the way since a frame, whose pose is taken from the truth."""
    at, _ = truth.at(travelled.stamps_ns, max_gap_ns=10**9)
    T_start = at.T_map_body[first] @ travelled.T_map_body[first].inverse()
    off = at.T_map_body[-1].distance(T_start @ travelled.T_map_body[-1])[0]
    return 100 * float(off / (truth.distances[-1] - truth.distances[first]))
