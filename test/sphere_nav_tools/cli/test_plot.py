"""A picture of a drive, and what is said of its states."""

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import read_tum, write_tum
from sphere_nav.localization.status import Reason, State, Status
from sphere_nav.ros.conversions import se3_to_pose_with_covariance, status_to_message
from sphere_nav_tools.offline import plot_figure
from sphere_nav_tools.offline.evaluation import trajectory_of
from worlds.commands import call
from worlds.recordings import write_bag

SECOND = 10**9
STATES = [State.SEARCHING, State.PROBATION, State.TRACKING, State.TRACKING, State.DEGRADED, State.LOST]
REASONS = ["", "", "", "", Reason.LOW_OVERLAP, Reason.TIMEOUT]


def status(number):
    stamp = (number + 1) * SECOND
    return Status(STATES[number], REASONS[number], remedy="turn back", milliseconds=5.0 + number, stamp_ns=stamp)


def place(number):
    return SE3.from_planar(0.5 * number, 0.1 * number, 0.2)


@pytest.fixture
def drive(tmp_path):
    def told(number):
        stamp = (number + 1) * SECOND
        yield "/car/pose", se3_to_pose_with_covariance(place(number), np.eye(6), stamp, "map")
        yield "/car/status", status_to_message(status(number), stamp, "map")

    write_bag(tmp_path / "drive", told, numbers=range(len(STATES)), with_mount=False)
    stamps = np.arange(1, 7) * SECOND
    truth = trajectory_of(stamps, [place(number) for number in range(6)])
    write_tum(tmp_path / "truth.tum", truth)
    return tmp_path


@pytest.mark.slow
def test_topics_are_found_by_type_and_name_and_the_table_says_the_remedy(drive, capsys):
    assert call("plot", drive / "drive", "-o", drive / "a.png") == 0
    said = capsys.readouterr().out
    assert "2  TRACKING" in said
    assert "DEGRADED   LOW_OVERLAP  turn back" in said
    assert "median 7.0 ms" in said  # without the silence
    assert (drive / "a.png").read_bytes().startswith(b"\x89PNG")


def test_poses_in_another_frame_than_the_truth_are_moved_to_it(drive, monkeypatch):
    elsewhere = SE3.from_planar(30.0, -4.0, 1.0)
    monkeypatch.chdir(drive)
    truth = read_tum(drive / "truth.tum")
    write_tum(drive / "truth.tum", truth.moved(elsewhere))
    drawn = []
    monkeypatch.setattr(plot_figure, "draw_localization", lambda path, poses, judged, *more: drawn.append(judged))
    for alignment in ("none", "poses"):
        assert call("plot", drive / "drive", "-o", drive / "a.png", "--truth", "truth.tum", "--align", alignment) == 0
    far, near = drawn
    assert far.errors.translation_m.min() > 10.0
    assert near.errors.translation_m.max() < 1e-6
    np.testing.assert_allclose(near.truth.positions, truth.moved(elsewhere).positions, atol=1e-6)
