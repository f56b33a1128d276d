"""Trajectories: TUM files there and back, what is wrong with a file, association and interpolation."""

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.geometry.odometry import OdometryBuffer
from sphere_nav.geometry.plausible import BOUNDS, check_length, check_lengths
from sphere_nav.geometry.trajectory import Trajectory, associate, read_tum, write_tum

SECOND = 10**9


@pytest.fixture
def trajectory():
    rng = np.random.default_rng(0)
    stamps = 1_700_000_000 * SECOND + np.cumsum(rng.integers(1, SECOND, size=30))
    factor = rng.normal(size=(30, 6, 6))
    return Trajectory(stamps, SE3.exp(rng.normal(size=(30, 6))), factor @ np.swapaxes(factor, -1, -2))


def test_a_tum_file_keeps_nanoseconds_poses_and_covariances_but_none_of_others(tmp_path, trajectory):
    write_tum(tmp_path / "poses.tum", trajectory)
    found = read_tum(tmp_path / "poses.tum")
    np.testing.assert_array_equal(found.stamps_ns, trajectory.stamps_ns)
    np.testing.assert_allclose(found.T_map_body.matrix, trajectory.T_map_body.matrix, atol=1e-7)  # nine digits
    np.testing.assert_allclose(found.covariances, trajectory.covariances, rtol=1e-8)
    write_tum(tmp_path / "poses.tum", Trajectory(trajectory.stamps_ns, trajectory.T_map_body))
    assert read_tum(tmp_path / "poses.tum").covariances is None
    write_tum(tmp_path / "poses.tum", trajectory)
    write_tum(tmp_path / "other.tum", trajectory[:5])
    (tmp_path / "other.cov").replace(tmp_path / "poses.cov")
    with pytest.raises(ValueError, match=r"poses\.cov: expected the 30 stamps of poses\.tum, found 5"):
        read_tum(tmp_path / "poses.tum")


def test_comments_commas_and_exponents_are_read(tmp_path):
    path = tmp_path / "poses.tum"
    path.write_text("# a comment\n\n1.5e0,1,2,3,0,0,0,1\n1305031098.665900000 1 2 3 0 0 0 -1\n")
    assert read_tum(path).stamps_ns.tolist() == [1_500_000_000, 1_305_031_098_665_900_000]


GOOD = "1.0 1 2 3 0 0 0 1\n"


def test_a_wrong_file_is_refused_with_file_line_and_field(tmp_path):
    for text, message in [
        ("", "expected poses, found none"),
        ("# timestamp tx ty tz qw qx qy qz\n" + GOOD, r":1: expected columns stamp x .*, found # timestamp tx .* qz"),
        (GOOD + "2.0 1 2 3 0 0 0\n", r":2: expected 8 columns \(stamp x y z qx qy qz qw\), found 7"),
        ("inf 1 2 3 0 0 0 1\n", r":1: stamp: expected a finite number, found 'inf'"),
        (GOOD + "1.0 1 2 3 0 0 0 1\n", r":2: stamp: expected later than the line before"),
    ]:
        path = tmp_path / "poses.tum"
        path.write_text(text)
        with pytest.raises(ValueError, match=message) as caught:
            read_tum(path)
        assert str(caught.value).startswith(str(path))
        assert "\n" not in str(caught.value)


def test_association_pairs_mutually_nearest_stamps_within_the_tolerance_also_of_almost_nothing():
    a = np.array([0, 100, 200, 300, 1000])
    b = np.array([5, 96, 104, 260, 5000])
    first, second = associate(a, b, 10)
    assert first.tolist() == [0, 1]
    assert second.tolist() == [0, 1]  # 96 and 104 are as near: one of them, once
    first, second = associate(a, b, 40)
    assert (first.tolist(), second.tolist()) == ([0, 1, 3], [0, 1, 3])
    first, second = associate(np.array([0, 6]), np.array([5]), 10)
    assert (first.tolist(), second.tolist()) == ([1], [0])  # nobody has two partners
    for other in [[], [7]]:
        first, second = associate(np.array([0, 10, 20]), np.array(other, dtype=np.int64), 5)
        assert len(first) == len(second) == len(other)


def test_interpolation_is_exact_on_a_constant_motion_and_does_not_cross_long_gaps():
    def moved(seconds):
        turned = SE3.exp(np.outer(seconds, [0.0, 0.0, 0.0, 0.2, -0.1, 0.3])).rotation
        return SE3.from_parts(turned, np.array([1.0, 2.0, 3.0]) + np.outer(seconds, [4.0, -5.0, 6.0]))

    stamps, poses = np.array([0, 1, 3]) * SECOND, moved([0, 1, 3])
    wanted = np.array([-1, 0, SECOND // 4, SECOND, 2 * SECOND, 3 * SECOND, 4 * SECOND])
    found, known = Trajectory(stamps, poses).at(wanted)
    assert known.tolist() == [False, True, True, True, True, True, False]
    np.testing.assert_allclose(found.T_map_body.matrix, moved([0, 0.25, 1, 2, 3]).matrix, atol=1e-12)
    trajectory = Trajectory(np.array([0, 1, 10]) * SECOND, SE3(np.repeat(np.eye(4)[None], 3, axis=0)))
    _, known = trajectory.at(np.array([0.5, 1, 5, 10]) * SECOND, max_gap_ns=2 * SECOND)
    assert known.tolist() == [True, True, False, True]


def test_a_length_of_another_unit_is_told_with_the_factor():
    for kind, (low, high) in BOUNDS.items():
        check_length(kind, low, "here")
        check_length(kind, high, "here")
        with pytest.raises(ValueError, match=r"here: expected metres, .*\(factor 0.001\)"):
            check_length(kind, 1.01 * high, "here")
    check_lengths("depth", np.array([np.nan, 0.0, np.inf]), "nothing")  # nothing is measured


def test_a_steady_motion_is_interpolated_and_carried_on_and_back_but_not_for_long():
    twist, step_ns, buffer = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.5]), 20_000_000, OdometryBuffer()

    def pose(stamp_ns):
        return SE3.exp(twist * stamp_ns * 1e-9)

    for stamp_ns in range(step_ns, 6 * step_ns, step_ns):
        buffer.add(stamp_ns, pose(stamp_ns), twist)
    assert len(buffer) == 5
    for stamp_ns in [-75_000_000, 0, step_ns, 45_000_000, 99_000_000, 100_000_000, 150_000_000]:
        np.testing.assert_allclose(buffer.carry_on(stamp_ns, 100_000_000).matrix, pose(stamp_ns).matrix, atol=1e-12)
    for stamp_ns in [-81_000_000, 201_000_000]:
        assert buffer.carry_on(stamp_ns, 100_000_000) is None
    buffer.clear()
    assert buffer.carry_on(5 * step_ns, 100_000_000) is None
