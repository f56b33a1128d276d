"""What the simulated repeats draw and judge by themselves; their rows are the commands."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rclpy")

from benchmarks.drive.repeats import KINDS, Drive, Found, Taught, draw_drives, judge
from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory, write_tum
from sphere_nav.ros.bags import BagWriter
from sphere_nav.ros.conversions import se3_to_odometry

SECOND = 10**9
GOOD = Found(100, 1.0, 1.0, 0, 0.01)


def test_every_kind_comes_once_in_a_round():
    drives = draw_drives(2 * len(KINDS) + 1, 3)
    assert sorted(drive.kind for drive in drives[: len(KINDS)]) == sorted(KINDS)
    assert [drive.visit for drive in drives[: len(KINDS)]] == [1] * len(KINDS)
    assert {drive.visit for drive in drives[len(KINDS) : -1]} == {2}
    assert drives[-1].visit == 3
    assert draw_drives(5, 3) == drives[:5] != draw_drives(5, 4)
    assert len({drive.parameters["season.parked"] for drive in drives}) == len(drives)


def test_what_is_judged_begins_with_the_second_visit_but_for_what_is_wrong():
    drives = [Drive(1, "snow", 1, 0.0), Drive(2, "snow", 2, 0.0), Drive(3, "", 2, 0.0)]
    found = [replace(GOOD, share=0.1, num_wrong=2), GOOD, replace(GOOD, share=0.9, lateral_rmse_m=0.04, num_images=50)]
    measured = [bound.measured for bound in judge(list(zip(drives, found, strict=True)), 1.5, "")]
    np.testing.assert_allclose(measured, [145 / 150, 0.9, 2, 1.5, 0.04])


def drive_of(poses):
    return Trajectory(np.arange(len(poses), dtype=np.int64) * SECOND, SE3(np.stack([T.matrix for T in poses])))


def test_errors_are_relative_to_the_taught_drive(tmp_path):
    """A map that bends by a degree a meter says nothing of the drive: what both are off by alike is no error."""
    step, bent = SE3.exp([1.0, 0, 0, 0, 0, 0]), SE3.exp([1.0, 0, 0, 0, 0, 0.02])
    true, mapped = [SE3.identity()], [SE3.exp([5.0, 5.0, 0, 0, 0, 1.0])]
    for _ in range(5):
        true, mapped = [*true, true[-1] @ step], [*mapped, mapped[-1] @ bent]
    with BagWriter(tmp_path / "teach") as bag:
        for i, T in enumerate(true):
            message = se3_to_odometry(T, np.zeros((6, 6)), (i + 1) * SECOND, ("world", "base_link"))
            bag.add_topic("/ground_truth/odometry", type(message))
            bag.write("/ground_truth/odometry", message, (i + 1) * SECOND)
    stamps = (np.arange(len(mapped)) + 1) * SECOND
    write_tum(tmp_path / "taught.tum", Trajectory(stamps, drive_of(mapped).T_map_body))
    taught = Taught(tmp_path / "teach", tmp_path / "taught.tum")
    off = SE3.exp([0.0, 0.1, 0, 0, 0, 0])  # the drive was beside the taught one, and the map says a little more
    more = SE3.exp([0.0, 0.13, 0, 0, 0, 0])
    found = taught.errors(drive_of([T @ more for T in mapped]), drive_of([T @ off for T in true]))
    np.testing.assert_allclose(found, np.tile([0.0, 0.03, 0.0], (6, 1)), atol=1e-6)
