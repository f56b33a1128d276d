"""An estimate against the truth: TUM files and bags in; errors, table, JSON and plot out."""

import argparse
import json
from contextlib import nullcontext

import numpy as np
import pytest

from sphere_nav.geometry import SE3
from sphere_nav.geometry.trajectory import Trajectory, write_tum
from sphere_nav_tools.cli import evaluate
from sphere_nav_tools.offline.evaluation import evaluate_poses, trajectory_of

SECOND = 10**9
OFFSET = np.array([0.03, -0.04, 0.0, 0.0, 0.0, 0.02])


def call(*words):
    parser = argparse.ArgumentParser()
    evaluate.add_arguments(parser)
    evaluate.run(parser.parse_args([str(word) for word in words]))


def circle(num_poses=200, hertz=10.0):
    s = np.arange(num_poses) * 0.1
    tangent = np.zeros((num_poses, 6))
    tangent[:, 0], tangent[:, 5] = s, s / 5.0
    return Trajectory((1000 * SECOND + np.arange(num_poses) * SECOND / hertz).astype(np.int64), SE3.exp(tangent))


TRUTH = circle()


@pytest.fixture
def files(tmp_path):
    """Half of the poses, each off by the same local motion, 2 ms late."""
    estimate = Trajectory(TRUTH.stamps_ns[::2] + 2_000_000, TRUTH.T_map_body[::2] @ SE3.exp(OFFSET))
    write_tum(tmp_path / "poses.tum", estimate)
    write_tum(tmp_path / "truth.tum", TRUTH)
    return tmp_path


def test_known_errors_come_out_in_json_and_table(files, capsys):
    words = files / "poses.tum", files / "truth.tum", "--json", files / "errors.json", "--tolerance"
    with pytest.raises(SystemExit):
        call(*words, "0")
    call(*words, "0.01")
    found = json.loads((files / "errors.json").read_text())
    assert found["n"] == 100
    assert found["coverage"] == 0.5
    for metric, expected in {
        "translation_m": 0.05,
        "rotation_deg": np.degrees(0.02),
        "lateral_m": 0.04,
        "longitudinal_m": 0.03,
    }.items():
        assert list(found[metric]) == ["median", "rmse", "p95", "max"]
        # V of the offset turns it by half its angle, 0.01 rad of 5 cm; the direction on a circle is exact.
        assert found[metric]["median"] == pytest.approx(expected, rel=0.02)
    assert found["rpe"]["translation_m"]["max"] < 0.05
    assert found["nees"] is None
    said = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["n", "100"] in said
    assert ["coverage", "0.5"] in said


def test_alignment_takes_a_moved_map_away(files):
    write_tum(files / "moved.tum", TRUTH.moved(SE3.exp([3, 1, 0, 0, 0.1, 1.0]), 1.25))
    call(files / "moved.tum", files / "truth.tum", "--align", "sim3", "--json", files / "e.json")
    found = json.loads((files / "e.json").read_text())
    assert found["translation_m"]["max"] < 1e-6
    assert found["alignment"]["scale"] == pytest.approx(0.8, rel=1e-6)


def test_a_map_frame_found_on_the_teaching_drive_is_applied_to_another(files, capsys):
    T_map_truth = SE3.exp([3, 1, 0.5, 0.1, 0.2, 1.0])
    taught, driven = TRUTH[:100].moved(T_map_truth), TRUTH[100:]
    shifted = driven.moved(SE3.from_planar(0.05, 0.0, 0.0)).moved(T_map_truth)  # an error of the whole drive
    write_tum(files / "taught.tum", taught)
    write_tum(files / "driven.tum", shifted)
    pair = ("--align-by", files / "taught.tum", files / "truth.tum")
    words = (files / "driven.tum", files / "truth.tum", "--json", files / "e.json", "--align", "poses")
    call(*words, *pair)
    assert json.loads((files / "e.json").read_text())["translation_m"]["median"] == pytest.approx(0.05, abs=1e-6)
    call(*words)
    assert json.loads((files / "e.json").read_text())["translation_m"]["median"] < 1e-6  # it hides it
    assert "aligned by poses: " in capsys.readouterr().out
    call(*words[:4], *pair)  # nothing else is needed
    assert json.loads((files / "e.json").read_text())["translation_m"]["median"] == pytest.approx(0.05, abs=1e-6)
    with pytest.raises(ValueError, match="--align-by: expected no --align, or poses, se3 or sim3, found none"):
        call(*words[:2], *pair, "--align", "none")


def test_frames_of_their_own_are_found_and_said(files, capsys):
    for motion, is_own in [
        ([3, 1, 0.5, 0.1, 0.2, 1.0], True),
        ([0, 0, 0, 0, 0, 0.2], True),
        ([0.1, 0, 0, 0, 0, 0.01], False),
    ]:
        write_tum(files / "driven.tum", TRUTH.moved(SE3.exp(motion)))
        call(files / "driven.tum", files / "truth.tum", "--json", files / "e.json")
        assert ("frames of their own (--align none compares" in capsys.readouterr().out) is is_own
        found = json.loads((files / "e.json").read_text())
        assert found["alignment"]["kind"] == ("poses" if is_own else "none")
        assert (found["translation_m"]["median"] < 1e-6) is is_own
    turned = Trajectory(TRUTH.stamps_ns, TRUTH.T_map_body @ SE3.exp([0, 0, 0, 0, 0, 0.2]))  # on the vehicle: it stays
    assert evaluate_poses(turned, TRUTH, alignment="auto").report["alignment"]["kind"] == "none"


def line(num_poses=50, hertz=10.0):
    """A drive of 5 m along x at 1 m/s."""
    x = np.arange(num_poses) / hertz
    return trajectory_of(1000 * SECOND + np.rint(x * SECOND), [SE3.from_planar(value, 0.0, 0.0) for value in x])


STRAIGHT = line()


def test_stamps_belong_together_within_ten_milliseconds_and_truth_spans_a_second_at_most():
    for late_ms, is_paired in [(9, True), (11, False)]:
        late = Trajectory(STRAIGHT.stamps_ns + late_ms * 10**6, STRAIGHT.T_map_body)
        refusal = pytest.raises(ValueError, match=r"within 0\.01 s, found 1000\.011 \.\.\. 1004\.911 s")
        with nullcontext() if is_paired else refusal:
            assert evaluate_poses(late, STRAIGHT).report["n"] == 50
    sparse = STRAIGHT[np.array([0, 9, 20, 49])]  # gaps of 0.9, 1.1 and 2.9 s
    found = evaluate_poses(STRAIGHT, sparse, is_interpolated=True)
    assert found.report["n"] == 10 + 2  # the first gap whole; else what lies on a row
    assert found.report["translation_m"]["max"] < 1e-9


def test_one_pair_is_aligned_by_nothing_that_it_is_judged_by():
    """Any pose fits one other in some frame."""
    estimate = TRUTH[:1].moved(SE3.exp([3.0, 0, 0, 0, 0, 0.5]))
    found = evaluate_poses(estimate, TRUTH, alignment="auto").report
    assert found["translation_m"]["median"] > 0.5
    assert found["alignment"]["kind"] == "none"
    with pytest.raises(ValueError, match="--align se3: expected several poses to align by, found one"):
        evaluate_poses(estimate, TRUTH, alignment="se3")
