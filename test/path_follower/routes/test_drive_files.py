"""Drives from files: as the follower smooths them, a drive for each direction, with speed and deviation."""

import numpy as np
import pytest

from path_follower.params import FollowerParams
from path_follower.routes.drive_files import read_drives
from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory, write_tum


def write_csv(path, poses, speed=0.8):
    rows = [f"{x:.4f},{y:.4f},{yaw:.5f},{speed}" for x, y, yaw in poses]
    path.write_text("\n".join(["# map_id: campus", "x,y,yaw,speed", *rows]))
    return path


def test_a_drive_forward_and_back_is_two_drives(tmp_path, kit):
    file = write_csv(tmp_path / "d.csv", kit.course((10, 0), (-6, 0.1)))
    drives, map_id = read_drives(file, FollowerParams())
    assert map_id == "campus"
    assert [drive.direction for drive in drives] == [1, -1]
    assert [drive.curve.length for drive in drives] == [pytest.approx(10, abs=0.1), pytest.approx(6, abs=0.1)]
    for drive in drives:  # in the order in which the vehicle heads
        ahead = np.diff(drive.curve.x) * np.cos(drive.curve.yaw[:-1]) + np.diff(drive.curve.y) * np.sin(
            drive.curve.yaw[:-1]
        )
        assert (ahead > 0).all()
        assert drive.curve.speed == pytest.approx(0.8)
        assert np.isnan(drive.deviation).all()


def test_reversible_drives_count_both_ways(tmp_path, kit):
    drives, _ = read_drives(write_csv(tmp_path / "d.csv", kit.course((10, 0))), FollowerParams(), is_reversible=True)
    assert [drive.direction for drive in drives] == [1, -1]


def test_how_well_a_taught_drive_was_localised_goes_along(tmp_path):
    poses = SE3(np.stack([SE3.from_planar(0.1 * i, 0, 0).matrix for i in range(101)]))
    covariances = np.tile(np.diag([1.0, 0.03**2, 1.0, 1.0, 1.0, 1.0]), (101, 1, 1))  # y of the body: across
    write_tum(tmp_path / "d.tum", Trajectory(10**9 + 10**8 * np.arange(101), poses, covariances), "hall")
    (drive,), map_id = read_drives(tmp_path / "d.tum", FollowerParams())
    assert map_id == "hall"
    assert drive.deviation == pytest.approx(0.03)
    assert np.median(drive.curve.speed) == pytest.approx(1.0, rel=0.02)


def test_a_file_that_cannot_be_driven_is_named(tmp_path):
    (tmp_path / "d.csv").write_text("0,0\n0.1,0\n")
    with pytest.raises(ValueError, match=r"d\.csv: path: expected a length of 0\.2"):
        read_drives(tmp_path / "d.csv", FollowerParams())
