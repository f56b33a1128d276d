"""An estimate against the truth, and the figures as text."""

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory
from sphere_nav_tools.offline.evaluation import error_table, evaluate_poses, read_trajectory

SECOND = 10**9


def line(num_poses=50, hertz=10.0):
    """A drive of 5 m along x at 1 m/s."""
    x = np.arange(num_poses) / hertz
    matrices = np.stack([SE3.from_planar(value, 0.0, 0.0).matrix for value in x])
    return Trajectory((1000 * SECOND + np.rint(x * SECOND)).astype(np.int64), SE3(matrices))


TRUTH = line()


def off(motion, covariances=None):
    return Trajectory(TRUTH.stamps_ns, TRUTH.T_map_body @ SE3.exp(motion), covariances)


def test_errors_are_in_their_units_and_by_their_sides():
    judged = evaluate_poses(off([0.03, 0.04, 0.0, 0.0, 0.0, np.radians(2.0)]), TRUTH)
    report = judged.report
    assert report["translation_m"]["max"] == pytest.approx(0.05, rel=0.02)
    assert report["rotation_deg"]["median"] == pytest.approx(2.0)
    assert judged.errors.lateral_m.mean() == pytest.approx(0.04, abs=1e-3)  # to the left
    assert judged.errors.longitudinal_m.mean() == pytest.approx(0.03, abs=1e-3)  # ahead
    assert (report["n"], report["num_estimates"], report["num_truth"]) == (50, 50, 50)
    assert report["length_m"] == pytest.approx(4.9)


def test_relative_errors_are_by_the_stretch():
    scaled = Trajectory(TRUTH.stamps_ns, TRUTH.moved(SE3.identity(), 1.02).T_map_body)
    for length in (1.0, 2.0):
        found = evaluate_poses(scaled, TRUTH, rpe_length_m=length).report["rpe"]
        assert found["translation_m"]["median"] == pytest.approx(0.02 * length, rel=1e-6)
        assert found["translation_percent"]["median"] == pytest.approx(2.0, rel=1e-6)
        assert found["length_m"] == length


def test_stamps_belong_together_within_ten_milliseconds():
    for late_ms, is_paired in [(9, True), (11, False)]:
        late = Trajectory(TRUTH.stamps_ns + late_ms * 10**6, TRUTH.T_map_body)
        if is_paired:
            assert evaluate_poses(late, TRUTH).report["n"] == 50
        else:
            with pytest.raises(
                ValueError, match=r"within 0\.01 s, found 1000\.011 \.\.\. 1004\.911 s against 1000\.000"
            ):
                evaluate_poses(late, TRUTH)


def test_truth_is_interpolated_over_gaps_of_a_second_at_most():
    sparse = TRUTH[np.array([0, 9, 20, 49])]  # gaps of 0.9, 1.1 and 2.9 s
    found = evaluate_poses(TRUTH, sparse, is_interpolated=True)
    assert found.report["n"] == 10 + 2  # the first gap whole; else what lies on a row
    assert found.report["translation_m"]["max"] < 1e-9


def test_the_table_says_what_was_found():
    errors = [0.1, 0.0, 0.0, 0.0, 0.0, 0.0]
    covariances = np.repeat(np.diag([0.01, 1, 1, 1, 1, 1.0])[None], 50, axis=0)
    lines = error_table(evaluate_poses(off(errors, covariances)[:25], TRUTH).report).splitlines()
    assert lines[0] == "25 poses paired, coverage 50.0 %, 2.40 m"
    assert lines[1].split() == ["median", "rmse", "p95", "max"]
    assert lines[2].split() == ["translation_m", *["0.1000"] * 4]
    assert [line.split()[0] for line in lines[3:6]] == ["rotation_deg", "lateral_m", "longitudinal_m"]
    assert lines[6].startswith("rpe_m / 1 m")
    assert lines[-2] == "NEES 1.00 (6 degrees of freedom, 25 covariances)"
    axes = "x 1.00, y 0.00, z 0.00, roll 0.00, pitch 0.00, yaw 0.00"
    assert lines[-1] == f"NEES of each axis of the body (1 degree of freedom): {axes}"
    short = error_table(evaluate_poses(off(errors)[:3], TRUTH).report)
    assert "rpe" not in short  # too short a way
    assert "NEES" not in short


def test_what_is_no_trajectory_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"none\.tum: expected a TUM file or a bag, found none"):
        read_trajectory(tmp_path / "none.tum", None, ("pose",))
    (tmp_path / "a.tum").write_text("1.0 0 0 0 0 0 0 1\n2.0 1 0 0 0 0 0 1\n")
    assert len(read_trajectory(tmp_path / "a.tum", None, ("pose",))) == 2
    with pytest.raises(ValueError, match=r"as a topic \(/pose\) is named"):
        read_trajectory(tmp_path / "a.tum", "/pose", ("pose",))
