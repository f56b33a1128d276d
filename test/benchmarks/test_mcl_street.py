"""What the benchmark of streets computes by itself: the correlation, its figures, frames of a drive as of KITTI."""

from __future__ import annotations

from argparse import Namespace

import cv2
import numpy as np
import pytest

from benchmarks import mcl_street
from benchmarks.mcl_street import _drive, _offsets, correlation, figures, read_calibration
from mcl_depth.likeness.comparison import visual_features
from mcl_depth.likeness.partial_filter import double_gradients

P2 = "P2: 700 0 600 70 0 700 180 0 0 0 1 0"
TR = "Tr_velo_to_cam: 0 -1 0 0.1 0 0 -1 -0.2 1 0 0 -0.3"


def test_the_correlation_is_the_sum_over_the_view_for_every_turn(rng) -> None:
    H, W = 6, 24
    seen = np.zeros((H, W), bool)
    seen[:, 8:16] = True
    visual = visual_features(rng.uniform(0, 255, (H, W)).astype(np.float32), seen)
    tensors = rng.standard_normal((2, 2, H, W)).astype(np.float32)
    found = correlation(visual, tensors)
    image = double_gradients(visual)
    for turn in (0, 1, 7):  # what the map shows at column u appears at column u + turn of the image
        turned = np.roll(tensors, turn, axis=-1) * visual.is_seen
        lengths = np.sqrt(np.sum(turned**2, axis=(1, 2, 3)))
        assert np.allclose(found[:, turn], np.sum(image * turned, axis=(1, 2, 3)) / lengths, rtol=1e-4)


def test_figures_tell_how_the_truth_stands_out(rng) -> None:
    curves = rng.standard_normal((81, 720))
    out, off, more = figures(curves + 0.0)
    assert abs(out) < 4.5
    assert more > 0.0
    curves[40, 719] = 30.0  # half a degree to the right
    out, off, more = figures(curves)
    assert out == pytest.approx(30.0, abs=1.0)
    assert off == 0.5
    assert more == 0.0
    curves[40, 719], curves[40, 680] = 0.0, 30.0
    assert figures(curves)[1] == 20.0
    assert np.array_equal(_offsets()[40], [0.0, 0.0])


def test_a_drive_as_kitti_has_it_is_read(tmp_path, rng) -> None:
    for folder in ("image_2", "velodyne"):
        (tmp_path / folder).mkdir()
    (tmp_path / "calib.txt").write_text(f"{P2}\n{TR}\n", encoding="utf-8")
    points = np.column_stack([rng.uniform(3.0, 9.0, (50, 3)), np.zeros(50)]).astype(np.float32)
    points[0, :3] = 0.5  # the car itself
    for name in ("000000", "000001", "000002"):
        points.tofile(tmp_path / "velodyne" / f"{name}.bin")
        cv2.imwrite(str(tmp_path / "image_2" / f"{name}.png"), np.full((370, 1226), 99, np.uint8))
    frames = list(_drive(Namespace(street=tmp_path, every=2)))
    assert [frame.name for frame in frames] == ["000000", "000002"]
    assert len(frames[0].points) == 49
    assert frames[0].camera.width == 1226
    K, T_lidar_camera = read_calibration(tmp_path / "calib.txt")
    assert K[0, 0] == 700.0
    assert np.allclose(T_lidar_camera[:3, 2], [1.0, 0.0, 0.0])
    # P2 = K [I | t]: camera 2 lies at -t of camera 0, 0.1 m to its left, and camera 0 at (0.3, 0.1, -0.2)
    assert np.allclose(T_lidar_camera[:3, 3], [0.3, 0.1 + 0.1, -0.2])


def test_a_calibration_that_is_none_is_refused(tmp_path) -> None:
    path = tmp_path / "calib.txt"
    path.write_text("P2: 1 2 3\n", encoding="utf-8")
    with pytest.raises(ValueError, match="P2: expected 12 numbers, found 3"):
        read_calibration(path)
    path.write_text(f"{P2}\n", encoding="utf-8")
    with pytest.raises(ValueError, match="Tr: expected 12 numbers, found 0"):
        read_calibration(path)
    with pytest.raises(ValueError, match="--every: expected at least 1, found 0"):
        list(_drive(Namespace(street=tmp_path, every=0)))
    with pytest.raises(ValueError, match=r"expected sweeps \.bin, found none"):
        list(_drive(Namespace(street=tmp_path, every=1)))


def test_p_is_asked_of_twenty_frames_against_eq2_and_the_mirrored(tmp_path, rng, monkeypatch) -> None:
    found = rng.standard_normal((20, 3, 2, 3))
    found[:, 2, 0, 0] += 5.0  # where measured, as it is
    monkeypatch.setattr(mcl_street, "_drive", lambda options: range(options.every))
    monkeypatch.setattr(mcl_street, "measure", lambda frame: found[frame])
    options = Namespace(surround=tmp_path / "none", street=tmp_path, every=20, threads=1)
    report = mcl_street.run(options)
    assert [bound.is_met for bound in report.bounds] == [True, True]
    assert len(report.tables) == 1
    found[:, 2, 0, 0] -= 5.0
    assert [bound.is_met for bound in mcl_street.run(options).bounds] == [False, False]
    options.every = 19
    assert not mcl_street.run(options).bounds
    options.every = 0
    assert mcl_street.run(options).skipped
