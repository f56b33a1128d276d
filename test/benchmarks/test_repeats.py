"""What the benchmark of repeats computes by itself; its rows are the commands."""

import argparse

import numpy as np
import pytest

pytest.importorskip("rclpy")

from benchmarks import repeats
from cycab_sim.params import SimParams
from cycab_sim.simulator import Simulator
from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.params import build


def way(offset=0.0, count=6):
    poses = SE3.exp(np.array([[i + (offset if i > 2 else 0.0), 0, 0, 0, 0, 0] for i in range(count)], dtype=float))
    return Trajectory(np.arange(count, dtype=np.int64) * 10**9, poses)


def test_what_is_far_from_the_truth_is_wrong():
    found = repeats.judge(way(0.5), way(), 0.3)
    assert (found.num_tracked, found.num_wrong) == (6, 3)
    assert found.cells(12) == ("50.0%", "3", "250.0 mm")
    assert repeats.judge(way(0.2), way(), 0.3).num_wrong == 0
    assert repeats.judge(way(), None, 0.3).cells(6) == ("100.0%", "no truth", "-")
    assert repeats.Found(0, 0.0, float("nan")).cells(6) == ("0.0%", "0", "-")


def test_a_simulated_recording_tells_where_base_link_is(tmp_path):
    simulator = Simulator(build(SimParams, repeats.SIMULATION | {"camera.size": "64,240", "world": "corridor"}))
    start = simulator.T_world_base
    repeats.record(simulator, tmp_path / "bag", 0.3)
    truth = repeats.true_poses(tmp_path / "bag")
    assert len(truth) == 2
    np.testing.assert_allclose(truth.T_map_body[0].matrix, start.matrix, atol=1e-9)
    assert repeats.find_recordings(_two(tmp_path), tmp_path / "work") == [tmp_path / "bag", tmp_path / "other"]


def _two(folder):
    (folder / "bag").rename(folder / "other")
    (folder / "bag").mkdir()
    for file in (folder / "other").iterdir():
        (folder / "bag" / file.name).write_bytes(file.read_bytes())
    return folder


@pytest.mark.parametrize(
    ("simulated", "budget", "told"),
    [
        (None, "", "expected at least two bags or recordings of a known kind, found 0"),
        (30, "3x", "expected experiences a place, as 3, or megabytes, as 200MB, found '3x'"),
    ],
)
def test_what_cannot_be_measured_is_refused_before_anything_is_driven(tmp_path, simulated, budget, told):
    options = argparse.Namespace(
        folders=[tmp_path], wrong=0.3, quick=True, threads=1, simulated=simulated, repeats_folder=None, budget=budget
    )
    with pytest.raises(ValueError, match=told):
        repeats.run(options)
