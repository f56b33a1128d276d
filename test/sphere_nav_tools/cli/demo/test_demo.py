"""The demo: its folder, verdict, errors by the truth, pictures, and a ROS domain of its own."""

import argparse
import os
from types import SimpleNamespace

import numpy as np
import pytest

from cycab_sim.params import SimParams, in_condition
from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory, write_tum
from sphere_nav.params import build
from sphere_nav.ros import conversions
from sphere_nav.ros.bags import BagWriter
from sphere_nav_tools.cli.demo.demo import (
    OTHER_DAY,
    Demo,
    DriveErrors,
    _in_motion,
    add_arguments,
    distances_from,
    drive_errors,
    exaggerate,
    has_ended,
    new_folder,
    verdict,
)
from sphere_nav_tools.cli.processes import FOR_DRIVES, claim_domain

SECOND = 10**9


@pytest.fixture
def make_demo(tmp_path, monkeypatch):
    """Return what makes a demo of 46 m, in place of a town that takes seconds to build."""
    world, parser = SimpleNamespace(path=SimpleNamespace(length=46.0)), argparse.ArgumentParser()
    monkeypatch.setattr("sphere_nav_tools.cli.demo.demo.build_world", lambda *_: world)
    monkeypatch.setattr("sphere_nav_tools.cli.demo.demo.claim_domain", lambda: 46)
    add_arguments(parser)
    return lambda *words: Demo(parser.parse_args(["-o", str(tmp_path / "demo"), *words]))


@pytest.mark.parametrize(
    ("lateral", "share", "has_finished", "told"),
    [
        ([0.02, -0.05, 0.01], 0.99, True, "the drive followed"),
        ([0.0, 0.3, 0.0], 1.0, True, "LEFT"),
        ([0.0, 0.0, 0.0], 0.5, True, "LEFT"),
        ([0.0, 0.01, 0.0], 0.99, False, "DID NOT FINISH"),
    ],
)
def test_a_drive_that_left_the_path_or_stopped_early_has_not_followed(make_demo, lateral, share, has_finished, told):
    demo = make_demo()
    demo.end, demo.has_finished = "follower FINISHED", has_finished
    judged = SimpleNamespace(report={"longitudinal_m": {"rmse": 0.04}})
    result = demo.result(DriveErrors(None, None, None, np.array(lateral), share, judged), 7)
    assert result["has_followed"] == (told == "the drive followed")
    assert result["lateral_max_m"] == max(map(abs, lateral))
    assert (result["lateral_rmse_m"], result["longitudinal_rmse_m"]) == pytest.approx(
        (np.sqrt(np.mean(np.square(lateral))), 0.04)
    )
    assert told in verdict(result)
    assert (result["share_driven"], result["length_m"]) == (share, 46.0)


def test_a_clock_that_was_held_up_is_no_end():
    assert has_ended("FINISHED END_OF_PATH")
    assert has_ended("STOPPED NOT_LOCALISED")
    assert not has_ended("STOPPED CLOCK_STOPPED")
    assert not has_ended("DRIVING")


def test_a_new_demo_keeps_the_last_result(tmp_path):
    (tmp_path / "demo").mkdir()
    (tmp_path / "demo" / "mine").touch()
    new_folder(tmp_path / "demo")
    assert (tmp_path / "demo_2" / "mine").exists()
    assert not any((tmp_path / "demo").iterdir())


def test_a_map_is_taught_by_day_though_the_second_drive_is_at_night(make_demo):
    demo = make_demo("--condition", "night_lamps")
    assert "condition" not in demo.simulation
    params = in_condition(build(SimParams, demo.simulation | demo.other_day))
    assert params.light.has_street_lamps
    assert params.imaging.noise == 3.0
    assert params.light.clouds == OTHER_DAY["light.clouds"]


def test_a_drive_and_a_test_never_share_a_domain_and_a_process_claims_each_once():
    assert range(50, 100) == FOR_DRIVES
    assert 0 < int(os.environ["ROS_DOMAIN_ID"]) < FOR_DRIVES.start
    first = 110 + 2 * (os.getpid() % 50)  # another suite beside this one tests by others
    two = range(first, first + 2)
    assert {claim_domain(two), claim_domain(two)} == set(two)
    with pytest.raises(RuntimeError, match=rf"expected one of range\({first}, {first + 2}\) that is free"):
        claim_domain(two)


def drive(points, yaw):
    """Poses at points (N, 2)."""
    poses = [SE3.from_planar(*point, turn).matrix for point, turn in zip(points, yaw, strict=True)]
    return Trajectory(SECOND * np.arange(len(poses)), SE3(np.stack(poses)))


def test_distances_from_the_path_are_exaggerated_to_their_side():
    taught = drive([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 1.0]], np.pi / 2 * np.array([0, 0, 1, 1]))
    driven = drive([[0.0, 0.01], [1.0, -0.02], [1.99, 1.0]], np.zeros(3))
    feet, lateral = distances_from(taught, driven)
    np.testing.assert_allclose(lateral, [0.01, -0.02, 0.01])  # left, right, left
    drawn = exaggerate(DriveErrors(taught, driven, taught.T_map_body.yaw[feet], lateral, 1.0, None))
    np.testing.assert_allclose(drawn, [[0.0, 0.5], [1.0, -1.0], [1.5, 1.0]], atol=1e-12)


def test_a_path_that_crosses_itself_is_followed_in_order():
    t = np.linspace(0, 2 * np.pi, 2000)
    eight = np.stack([10 * np.sin(t), 5 * np.sin(2 * t)], axis=-1)
    ahead = np.gradient(eight, axis=0)
    yaw = np.arctan2(ahead[:, 1], ahead[:, 0])
    feet, lateral = distances_from(drive(eight, yaw), drive(eight[::10], yaw[::10]))
    assert np.all(np.diff(feet) > 0)
    assert np.abs(lateral).max() < 0.02


def write_drive(path, offset, with_poses):
    """Drive 5 m straight at 1 m/s, `offset` m to the left."""
    with BagWriter(path) as bag:
        for i in range(101):
            stamp = SECOND + i * SECOND // 20
            T_world_base = SE3.from_planar(i / 20, offset, 0.0)
            truth = conversions.se3_to_odometry(
                T_world_base, np.zeros((6, 6)), stamp, ("world", "base_link"), np.zeros(6)
            )
            bag.write("/ground_truth/odometry", truth, stamp)
            if with_poses and i % 2 == 0:
                T_map_base = SE3.from_planar(0.1, 0.0, 0.0) @ T_world_base  # the map begins 0.1 m behind the world
                pose = conversions.se3_to_pose_with_covariance(T_map_base, np.eye(6), stamp, "map")
                bag.write("/pose", pose, stamp)


def test_a_drive_beside_the_path_is_told_by_its_distance(tmp_path):
    write_drive(tmp_path / "teach", 0.0, with_poses=False)
    write_drive(tmp_path / "drive", 0.07, with_poses=True)
    stamps = SECOND + np.arange(0, 101, 2) * SECOND // 20
    x = np.arange(51) / 10
    taught = SE3.from_parts(np.broadcast_to(np.eye(3), (51, 3, 3)), np.stack([x + 0.1, 0 * x, 0 * x], axis=1))
    write_tum(tmp_path / "taught.tum", Trajectory(stamps, taught))
    errors = drive_errors(tmp_path)
    assert errors.lateral == pytest.approx(0.07, abs=1e-6)
    assert errors.judged.report["longitudinal_m"]["max"] < 1e-6
    assert errors.share_driven > 0.99


def test_only_poses_in_motion_count():
    found = _in_motion(drive([[x, 0.0] for x in (0, 0, 0, 1, 2, 2, 3, 3)], np.zeros(8)))
    assert found.positions[:, 0].tolist() == [0.0, 1.0, 2.0, 3.0]
