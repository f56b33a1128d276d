"""What the end-to-end benchmark computes by itself; its rows are the commands."""

import argparse

import numpy as np
import pytest

pytest.importorskip("rclpy")

from benchmarks import end_to_end
from sphere_nav.geometry import SE3, Pinhole
from sphere_nav.geometry.trajectory import Trajectory

CAMERA = Pinhole(101, 101, 50.0, 50.0, 50.0, 50.0)  # sees x within +-z


def test_share_of_points_in_the_image():
    points = np.array([[0.0, 0, 2], [1.9, 0, 2], [2.1, 0, 2], [0, 0, -2]])
    assert end_to_end.share_seen(CAMERA, points) == 0.5
    assert end_to_end.share_seen(CAMERA, points[:0]) == 0.0


def test_errors_are_distances_in_m():
    stamps = np.arange(5, dtype=np.int64) * 10**9
    moved = SE3.exp(np.array([[float(i), 0, 0, 0, 0, 0] for i in range(5)]))
    truth = Trajectory(stamps, moved)
    found = end_to_end.errors(Trajectory(stamps, SE3.exp([0, 0.03, 0.04, 0, 0, 0]) @ moved), truth)
    np.testing.assert_allclose(found, 0.05)


def test_absent_recordings_are_skipped_with_a_note(tmp_path):
    report = end_to_end.run(argparse.Namespace(recordings=tmp_path, threads=1, kitchens=None, anchors=["truth"]))
    assert "no recordings" in report.skipped
    assert sum("skipped, no folder" in note for note in report.notes) == 3


def test_a_command_that_fails_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"sphere_nav map-info: expected status 0, found 2: .*absent"):
        end_to_end.call("map-info", tmp_path / "absent")


@pytest.mark.parametrize(
    ("text", "name", "bound"),
    [
        ("0:120/120:240", "120:240 in 0:120", (8.0, 0.4)),
        ("300:420/420:460", "420:460 in 300:420", (8.0, 0.4)),
        ("240:700/700:999", "700:999 in 240:700", (15.0, 0.4)),
        ("0:240:2/1:240:2", "odd in even frames", (2.5, 0.1)),
        ("300:540:2/301:540:2", "301:540:2 in 300:540:2", (2.5, 0.1)),
    ],
)
def test_a_split_has_the_bound_of_its_kind(text, name, bound):
    split = end_to_end.Split.read(text)
    assert (str(split), split.bound) == (name, bound)


@pytest.mark.parametrize("text", ["0:120", "0:120/120", "0:a/1:2", "0:1:0/1:2", "0:1/1:2/2:3"])
def test_what_is_no_split_is_named(text):
    with pytest.raises(ValueError, match=f"--kitchens: expected .*, found {text}$"):
        end_to_end.Split.read(text)


def test_a_split_beyond_the_recording_names_the_pose_that_is_not_there(tmp_path):
    (tmp_path / "frame-000239.pose.txt").touch()
    assert end_to_end.Split.read("0:120/120:240").missing(tmp_path) is None
    for beyond in ("0:120/120:241", "0:241/120:240"):
        assert end_to_end.Split.read(beyond).missing(tmp_path) == tmp_path / "frame-000240.pose.txt"
