from types import SimpleNamespace

import numpy as np
import pytest

from sphere_mapping.ros.mount import CameraMount
from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav.ros.bags import BagError
from sphere_nav.spheres.graph import KeySphere, SphereGraph
from sphere_nav_tools.offline.mapping import drive as mapped
from sphere_nav_tools.offline.mapping.drive import MappedDrive, Truth

STAMPS = [1_000_000_000 * k for k in range(1, 6)]
WAY = [SE3.from_planar(0.5 * k, 0.1 * k * k, 0.1 * k) for k in range(5)]
T_TRUTH_MAP = SE3.exp([3.0, -2.0, 0.5, 0.0, 0.0, 1.0])


def truth_of(poses):
    matrices = np.stack([(T_TRUTH_MAP @ pose).matrix for pose in poses])
    return Truth(Trajectory(np.array(STAMPS), SE3(matrices)), is_base=False)


@pytest.fixture
def drive():
    mapper = SimpleNamespace(trajectory=lambda: zip(STAMPS, WAY, strict=True), graph=[None] * 3, num_loops=1)
    mount = CameraMount("camera", False, SE3.from_planar(0.4, 0.0, 0.0))
    return MappedDrive(mapper, mount, num_lost=2)


def test_a_drive_is_laid_on_its_truth_by_its_first_pose_or_by_all(drive):
    for found in (drive.anchor(truth_of(WAY)), drive.fit(truth_of(WAY))):
        np.testing.assert_allclose(found.matrix, T_TRUTH_MAP.matrix, atol=1e-9)
    off = [WAY[0] @ SE3.from_planar(0.05, 0.0, 0.0), *WAY[1:]]  # the first true pose is wrong
    errors = [float(find(truth_of(off)).distance(T_TRUTH_MAP)[0]) for find in (drive.anchor, drive.fit)]
    assert errors[0] == pytest.approx(0.05)
    assert errors[1] < 0.015
    late = Truth(truth_of(WAY).poses.moved(SE3.identity()), is_base=False)
    elsewhere = Truth(Trajectory(late.poses.stamps_ns + 10**12, late.poses.T_map_body), is_base=False)
    assert drive.fit(elsewhere) is None
    assert drive.anchor(elsewhere) is None


def test_what_is_told_counts_and_compares(drive):
    lines = drive.summary(truth_of(WAY))
    assert lines[0].startswith("5 spheres placed, 2 lost, 3 kept, 1 loops closed")
    assert "median 0.0 mm, max 0.0 mm" in lines[1]
    drive.mapper.num_loops, drive.stereo, drive.depth = 0, "stereo: ...", "depth: ..."
    drive.refused, drive.damages = {"{n} of depth": 3}, ["chunk 7", "chunk 9"]
    counted = lines[0].replace("1 loops", "0 loops")
    left_out = "not readable, left out: chunk 7; chunk 9"
    assert drive.summary(None) == ["stereo: ...", counted, "depth: ...", "refused: 3 of depth", left_out]


def test_a_drive_that_is_lost_says_so_and_tells_no_drift(drive):
    assert drive.loss == ""
    drive.num_lost = 5
    assert drive.loss == ""  # half of them
    drive.num_lost = 6
    assert drive.loss.startswith("expected most of 11 spheres placed, found 6 lost (55%): smaller steps")
    assert "odometry" in drive.loss
    assert len(drive.summary(truth_of(WAY))) == 1
    drive.num_lost = 0
    drive.mapper.trajectory = lambda: zip(STAMPS, [WAY[1]] * 5, strict=True)
    assert "drift" not in drive.summary(truth_of([WAY[1]] * 5))[-1]  # it has not moved


def test_a_map_begins_at_its_first_sphere_or_lies_on_the_truth(drive, monkeypatch):
    graph = SphereGraph([KeySphere(k, stamp, pose) for k, (stamp, pose) in enumerate(zip(STAMPS, WAY, strict=True))])
    drive.mapper.graph, truth = graph, truth_of(WAY)
    T, found, warnings = drive.anchor_graph("first", truth, "here/drive")
    assert (T.matrix.tolist(), warnings) == (np.eye(4).tolist(), [])
    assert found is graph
    T, found, warnings = drive.anchor_graph("truth", truth, "here/drive")
    np.testing.assert_allclose(T.matrix, T_TRUTH_MAP.matrix, atol=1e-9)
    for node in found:  # the graph moves as a whole
        np.testing.assert_allclose(node.T_map_sphere.matrix, (T @ WAY[node.id]).matrix, atol=1e-12)
    monkeypatch.setattr(mapped, "move_to_truth", lambda graph, truth, T: graph.with_poses({0: SE3.identity()}))
    monkeypatch.setattr(mapped, "check_survey", lambda aligned, surveyed, source: [source])
    T, found, warnings = drive.anchor_graph("survey", truth, "here/drive")
    assert warnings == ["here/drive"]
    np.testing.assert_array_equal(found[0].T_map_sphere.matrix, np.eye(4))
    elsewhere = Truth(Trajectory(truth.poses.stamps_ns + 10**12, truth.poses.T_map_body), is_base=False)
    for unknown in (elsewhere, None):
        with pytest.raises(BagError, match="here/drive: ground_truth/pose or ground_truth/odometry: expected poses"):
            drive.anchor_graph("truth", unknown, "here/drive")
