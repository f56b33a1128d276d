"""What the end-to-end benchmark computes by itself; its rows are the commands."""

from argparse import Namespace

import numpy as np
import pytest

pytest.importorskip("rclpy")

from benchmarks.commands import call, errors
from benchmarks.real.end_to_end import run, splits
from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory


def test_errors_are_distances_in_m():
    stamps = np.arange(5, dtype=np.int64) * 10**9
    moved = SE3.exp(np.array([[float(i), 0, 0, 0, 0, 0] for i in range(5)]))
    truth = Trajectory(stamps, moved)
    found = errors(Trajectory(stamps, SE3.exp([0, 0.03, 0.04, 0, 0, 0]) @ moved), truth)
    np.testing.assert_allclose(found, 0.05)


def test_absent_recordings_are_skipped_with_a_reason(tmp_path):
    assert "no recordings" in run(Namespace(data=tmp_path, size="quick", seed=1)).skipped


def test_a_command_that_fails_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"sphere_nav map-info: expected status 0, found 2: .*absent"):
        call("map-info", tmp_path / "absent")


@pytest.mark.parametrize("seed", [0, 77, 4177])
@pytest.mark.parametrize("is_quick", [True, False])
def test_frames_that_are_localised_were_not_mapped_and_are_of_the_recording(seed, is_quick):
    for split in splits(seed, is_quick=is_quick):
        mapped, localised = (set(range(*map(int, words.split(":")))) for words in (split.mapped, split.localised))
        assert not mapped & localised
        assert max(mapped | localised) < 360
        assert len(localised) >= 40
