"""A mapped drive: its truth, its survey, what is told of it, and which pairs of it are compared."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from sphere_mapping.acquisition.stereo.stereo_field import StereoField
from sphere_mapping.acquisition.stereo.track_fit import ColumnFit
from sphere_mapping.mapper import Mapper
from sphere_mapping.ros.intake import TOPICS
from sphere_mapping.ros.mount import CameraMount
from sphere_nav.geometry import SE3, Spherical
from sphere_nav.ros.bags import BagError, BagReader, BagWriter
from sphere_nav.ros.conversions import sphere_to_message
from sphere_nav.ros.maps.writer import MapDetails
from sphere_nav.spheres.graph import Edge, KeySphere, SphereGraph
from sphere_nav_tools.offline.evaluation import read_poses, trajectory_of
from sphere_nav_tools.offline.mapping import drive as mapped
from sphere_nav_tools.offline.mapping import stereo_drive
from sphere_nav_tools.offline.mapping.drive import MappedDrive, Recipe, check_survey, move_to_truth, read_truth
from sphere_nav_tools.offline.mapping.extension import place_start
from sphere_nav_tools.offline.mapping.replay_mapper import replay_mapper
from sphere_nav_tools.offline.mapping.stereo_drive import PairCollector, collect, find_field
from worlds.recordings import stereo, truth_of_base, write_bag
from worlds.room import wide_room

STAMPS = [1_000_000_000 * k for k in range(1, 6)]
WAY = [SE3.from_planar(1.0 + 0.5 * k, 0.1 * k * k - 2.0, 0.3 + 0.1 * k) for k in range(5)]
T_TRUTH_MAP = SE3.exp([3.0, -2.0, 0.5, 0.0, 0.0, 1.0])


def laid_out(poses):
    return trajectory_of(STAMPS, [T_TRUTH_MAP @ pose for pose in poses])


@pytest.fixture
def drive():
    mapper = SimpleNamespace(
        trajectory=lambda: zip(STAMPS, WAY, strict=True), tracks=STAMPS, graph=[None] * 3, num_loops=1
    )
    mount = CameraMount("camera", False, SE3.from_planar(0.4, 0.0, 0.0))
    return MappedDrive(SimpleNamespace(stereo=""), mapper, mount, num_lost=2)


def test_a_summary_counts_spheres_and_what_was_refused(drive):
    (counted,) = drive.summary()
    assert counted.startswith("5 spheres placed, 2 lost, 3 kept, 1 loops closed")
    drive.recipe.stereo, drive.refusal = "stereo: ...", "3 of depth"
    assert drive.summary() == ["stereo: ...", counted, "refused: 3 of depth"]


def test_a_drive_that_is_lost_says_so(drive):
    assert drive.loss == ""
    drive.num_lost = 5
    assert drive.loss == ""  # half of them
    drive.num_lost = 6
    assert drive.loss.startswith("expected most of 11 spheres placed, found 6 lost (55%): smaller steps")
    assert "odometry" in drive.loss


def test_a_map_begins_at_its_first_sphere_or_lies_on_the_truth(drive, monkeypatch):
    graph = SphereGraph([KeySphere(k, stamp, pose) for k, (stamp, pose) in enumerate(zip(STAMPS, WAY, strict=True))])
    drive.mapper.graph, here = graph, Path("here/drive")
    monkeypatch.setattr(mapped, "read_truth", lambda path, mount: laid_out(WAY))
    T, found, warnings = drive.anchor_graph("first", here)
    assert (T.matrix.tolist(), warnings) == (np.eye(4).tolist(), [])
    assert found is graph
    T, found, warnings = drive.anchor_graph("truth", here)
    np.testing.assert_allclose(T.matrix, T_TRUTH_MAP.matrix, atol=1e-9)
    for node in found:  # the graph moves as a whole
        np.testing.assert_allclose(node.T_map_sphere.matrix, (T @ WAY[node.id]).matrix, atol=1e-12)
    monkeypatch.setattr(mapped, "move_to_truth", lambda graph, truth: graph.with_poses({0: SE3.identity()}))
    monkeypatch.setattr(mapped, "check_survey", lambda aligned, surveyed, source: [source])
    T, found, warnings = drive.anchor_graph("survey", here)
    assert warnings == [here]
    np.testing.assert_array_equal(found[0].T_map_sphere.matrix, np.eye(4))
    off = [WAY[0] @ SE3.from_planar(0.05, 0.0, 0.0), *WAY[1:]]  # the first true pose is wrong
    monkeypatch.setattr(mapped, "read_truth", lambda path, mount: laid_out(off))
    assert float(drive.anchor_graph("truth", here)[0].distance(T_TRUTH_MAP)[0]) < 0.015
    late = replace(laid_out(WAY), stamps_ns=laid_out(WAY).stamps_ns + 10**12)
    monkeypatch.setattr(mapped, "read_truth", lambda path, mount: late)
    with pytest.raises(BagError, match="here/drive: stamps: expected some in common to align by, found 1"):
        drive.anchor_graph("truth", here)


def test_a_true_pose_of_the_base_is_not_taken_for_one_of_the_camera(tmp_path):
    write_bag(tmp_path / "base", truth_of_base, numbers=range(2))
    write_bag(tmp_path / "none", stereo, numbers=range(1))
    mount = CameraMount("camera", False, SE3.from_planar(0.4, 0.1, 0.3), SE3.from_planar(0.0, 0.2, 0.1))
    told = read_poses(tmp_path / "base", ("ground_truth/odometry",)).T_map_body
    found = read_truth(tmp_path / "base", mount).T_map_body
    np.testing.assert_allclose(found.matrix, (told @ mount.T_base_sphere).matrix)
    with pytest.raises(BagError, match="none: expected topic /ground_truth/pose"):
        read_truth(tmp_path / "none", mount)


def test_key_spheres_move_to_their_true_poses_where_these_are_known():
    stamps = np.array([0, 1, 2, 4]) * 10**9
    truth = trajectory_of(stamps, [SE3.from_planar(float(x), 1.0, 0.5) for x in (0, 1, 2, 4)])
    nodes = [KeySphere(k, int(s * 1e9), SE3.from_planar(9.0, 9.0, 0.0)) for k, s in enumerate((0.5, 2.0, 3.0, 7.0))]
    found = move_to_truth(SphereGraph(nodes), truth)
    np.testing.assert_allclose(found[0].T_map_sphere.matrix, SE3.from_planar(0.5, 1.0, 0.5).matrix, atol=1e-9)
    # the last two: between rows two seconds apart, and behind the last
    assert [node.T_map_sphere.translation[0] == 9.0 for node in found] == [False, False, True, True]


SIGMA = np.repeat([0.004, 0.001], 3)


def test_a_motion_contradicts_the_survey_once_in_ten_thousand_by_chance():
    """Its deviations count twice, the survey has 1 cm and 0.3 deg of its own; chi2 of six degrees of freedom."""
    for factor, is_named in [(0.99, False), (1.01, True)]:
        for axis in [0, 2, 4]:
            limit = np.sqrt(chi2.isf(1e-4, 6))
            sigma = np.sqrt((2.0 * SIGMA) ** 2 + np.repeat([0.01, np.radians(0.3)], 3) ** 2)
            xi = np.zeros(6)
            xi[axis] = -factor * limit * sigma[axis]
            edges = [Edge(k, k + 1, SE3.identity(), np.diag(1 / SIGMA**2)) for k in range(3)]
            graph = SphereGraph([KeySphere(k, k, SE3.identity()) for k in range(4)], edges)
            off = SE3.exp(xi)
            # the last motion alone is off
            found = check_survey(graph, graph.with_poses({0: off, 1: off, 2: off}), "drive")
            assert bool(found) == is_named
            if is_named:
                meters, radians = np.linalg.norm(xi[:3]), np.linalg.norm(xi[3:])
                assert f"2 to 3 by {1e3 * meters:.0f} mm, {np.degrees(radians):.2f} deg (5.3 sigma)" in found[0]


@pytest.mark.parametrize(("num_wrong", "is_refused"), [(6, False), (7, True)])
def test_a_survey_is_refused_when_more_than_half_of_the_motions_contradict(num_wrong, is_refused):
    edges = [Edge(k, k + 1, SE3.identity(), 1e6 * np.eye(6)) for k in range(12)]
    graph = SphereGraph([KeySphere(k, k, SE3.identity()) for k in range(13)], edges)
    poses = {k: SE3.from_planar(0.2 * min(k, num_wrong), 0.0, 0.0) for k in range(13)}
    if is_refused:
        with pytest.raises(BagError, match="7 of 12 motions"):
            check_survey(graph, graph.with_poses(poses), "drive")
    else:
        (line,) = check_survey(graph, graph.with_poses(poses), "drive")
        assert line.startswith("warning: 6 of 12 motions between key spheres contradict the survey")
        assert line.count(" to ") == 1  # the worst by name


CAMERA = Spherical(128, 64)
SECOND = 1_000_000_000


@pytest.fixture(scope="module")
def recipe(tmp_path_factory):
    """Six spheres, the last one of a covered lens."""
    room, path = wide_room(), tmp_path_factory.mktemp("replay") / "bag"
    with BagWriter(path) as bag:
        for number in range(1, 7):
            sphere = room.sphere(SE3.from_planar(-0.8 + 0.1 * number, 0.1, 0.05 * number), CAMERA, 1)
            image = sphere.image * (number < 6)
            message = sphere_to_message(replace(sphere, image=image, stamp_ns=number * SECOND), "base_link")
            bag.write("sphere", message, number * SECOND)
    return Recipe(path, {}, {}, MapDetails(), "sphere")


def test_a_drive_is_mapped_and_what_was_lost_is_counted(recipe):
    drive = replay_mapper(recipe, Mapper)
    assert [track.stamp_ns // SECOND for track in drive.mapper.tracks] == [1, 2, 3, 4, 5]
    assert drive.num_lost == 1
    assert drive.mapper.origin == "base_link at the first sphere, level by the mounting"


def test_a_given_start_is_where_and_as_it_was_told_beside_a_key_sphere_that_is_turned():
    """On the same slope, of a camera that sits ahead of the base and looks to the left."""
    T_base_sphere = SE3.from_angles(0.0, 0.0, 0.4, [0.5, 0.1, 1.2])
    T_map_base = SE3.from_angles(0.0, 0.1, 2.0, [3.0, 4.0, 0.7])
    nodes = [KeySphere(0, 0, T_map_base @ T_base_sphere), KeySphere(1, 1, SE3.from_planar(90.0, 0.0, 0.0))]
    found = place_start(SimpleNamespace(graph=SphereGraph(nodes)), (3.5, 4.5, -1.0), T_base_sphere)
    expected = SE3.from_angles(0.0, 0.1, -1.0, [3.5, 4.5, 0.7])
    np.testing.assert_allclose((found @ T_base_sphere.inverse()).matrix, expected.matrix, atol=1e-9)


def test_a_right_pair_is_left_alone(tmp_path):
    write_bag(tmp_path / "bag", stereo, numbers=range(5))
    with BagReader(tmp_path / "bag") as bag:
        values, remap = {"input": "stereo"}, {name: f"/{name}" for name in TOPICS["stereo"]}
        pair, words = find_field(bag, values, remap)
        assert len(list(collect(bag, values, remap, PairCollector)[1])) == 5
    assert not any(pair.correction.columns)
    assert words.startswith("stereo: rows off by 0.")
    assert words.endswith("disparity as told")


@pytest.mark.parametrize(
    ("columns", "words"), [(None, "as told"), ([2.5, 1.0], "too small"), ([0.01, 0.02], "as told")]
)
def test_a_disparity_is_corrected_only_where_chance_would_hardly_give_its_error(tmp_path, monkeypatch, columns, words):
    write_bag(tmp_path / "bag", stereo, numbers=range(2))
    fit = None if columns is None else ColumnFit(np.array(columns), np.diag([0.01, 0.04]), 300)
    monkeypatch.setattr(stereo_drive, "fit_columns", lambda camera, baseline_m, windows: fit)
    with BagReader(tmp_path / "bag") as bag:
        pair, found = find_field(bag, {"input": "stereo"}, {name: f"/{name}" for name in TOPICS["stereo"]})
    assert words in found
    assert tuple(pair.correction.columns) == (tuple(columns) if words == "too small" else StereoField().columns)
