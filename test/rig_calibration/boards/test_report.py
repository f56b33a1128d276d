"""The figures of a calibration in their units, and what its parts say of each other."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure

from rig_calibration.boards import validation
from rig_calibration.boards.bundle import RigState, rig_problem
from rig_calibration.boards.report import calibration_as_mapping, coverage, draw_calibration
from rig_calibration.boards.views import observations
from sphere_nav.geometry import SE3, Fisheye, Pinhole

PINHOLE = Pinhole(80, 60, 100.0, 101.0, 39.0, 29.0, (0.1, 0.2, 0.3, 0.4, 0.5))
FISHEYE = Fisheye(160, 120, 90.0, 91.0, 79.0, 59.0, (0.01, 0.02, 0.03, 0.04))


@pytest.fixture
def calibration():
    """Two cameras of one view each, four and three corners; every figure another one."""
    pixels = [
        np.array([[5.0, 5.0], [6.0, 5.0], [15.0, 5.0], [79.0, 59.0]]),
        np.array([[1.0, 1.0], [159.0, 1.0], [50.0, 60.0]]),
    ]
    seen = observations([0, 1], [0, 0], [0, 0], [np.zeros((4, 3)), np.zeros((3, 3))], pixels)
    residuals = np.array([[0.3, 0.4], [0.0, 0.1], [0.2, 0.0], [9.0, 9.0], [0.6, 0.8], [0.0, 0.0], [0.0, 0.5]])
    lenses = np.zeros((2, 12))
    for lens, camera in zip(lenses, (PINHOLE, FISHEYE), strict=True):
        lens[: 4 + len(camera.distortion)] = camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion
    specs = [
        SimpleNamespace(name="a", model="pinhole", size=(80, 60)),
        SimpleNamespace(name="b", model="fisheye", size=(160, 120)),
    ]
    spread = SimpleNamespace(
        noise_px=0.25,
        lens_std=np.arange(24.0).reshape(2, 12),
        pose_std=np.array([[0.001, 0.002, np.inf, 0.01, 0.02, 0.03], np.full(6, 0.5)]),
    )
    halves = np.array([[0.004, -0.005, 0.006, -0.1, 0.2, 0.3], np.full(6, np.nan)])
    sizes = ((80, 60), (160, 120))
    problem = SimpleNamespace(seen=seen, models=("pinhole", "fisheye"), sizes=sizes)
    still = SE3(np.eye(4)[None])
    return SimpleNamespace(
        specs=specs,
        start=SimpleNamespace(problem=problem, views=[SimpleNamespace(blur_px=blur) for blur in (0.6, np.nan, 0.8)]),
        state=RigState(lenses, SE3(np.tile(np.eye(4), (2, 1, 1))), still, still),
        residuals=residuals,
        kept=np.array([1.0, 1, 1, 0, 1, 1, 1]),
        spread=spread,
        validation=SimpleNamespace(
            halves=halves, held_out_px=np.array([0.7, np.nan]), focal_halves=np.array([0.012, np.nan])
        ),
        dropped={"a/1/b": "why"},
        warnings=["w"],
    )


def test_every_figure_has_its_unit(calibration):
    found = calibration_as_mapping(calibration)
    a, b = found["cameras"]["a"], found["cameras"]["b"]
    assert a["lens"] == [100.0, 101.0, 39.0, 29.0, 0.1, 0.2, 0.3, 0.4, 0.5]
    assert b["lens"] == [90.0, 91.0, 79.0, 59.0, 0.01, 0.02, 0.03, 0.04]
    assert (a["lens_std"], b["lens_std"]) == (list(range(9)), list(range(12, 20)))
    assert a["rms_px"] == pytest.approx(np.sqrt((0.25 + 0.01 + 0.04) / 3))  # the last corner does not count
    assert b["rms_px"] == pytest.approx(np.sqrt((1.0 + 0.25) / 3))
    assert found["rms_px"] == pytest.approx(np.sqrt(1.55 / 6))
    assert a["position_std_mm"] == [pytest.approx(1.0), pytest.approx(2.0), None]
    assert a["rotation_std_deg"] == pytest.approx(np.degrees([0.01, 0.02, 0.03]))
    assert a["halves_position_mm"] == pytest.approx([4.0, -5.0, 6.0])
    assert a["halves_rotation_deg"] == pytest.approx(np.degrees([-0.1, 0.2, 0.3]))
    assert b["halves_position_mm"] == b["halves_rotation_deg"] == [None] * 3
    assert (a["held_out_rms_px"], b["held_out_rms_px"]) == (0.7, None)
    assert (a["blur_px"], b["blur_px"], a["tilt_deg"]) == (0.6, None, 0.0)
    assert (a["halves_focal_percent"], b["halves_focal_percent"]) == (pytest.approx(1.2), None)
    assert (found["noise_px"], found["num_views"], found["rejected_corners"]) == (0.25, 3, 1)
    assert (found["rejected_views"], found["warnings"]) == ({"a/1/b": "why"}, ["w"])


def test_coverage_counts_cells_of_a_grid_of_eight_by_six(calibration):
    np.testing.assert_allclose(coverage(calibration), [100 * 2 / 48, 100 * 3 / 48])  # cells of 10, of 20 pixels


def test_residuals_are_drawn_up_to_three_times_their_noise(calibration, monkeypatch, tmp_path):
    drawn = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: drawn.extend(figure.axes))
    draw_calibration(calibration, tmp_path / "a.png")
    assert [axes.get_title() for axes in drawn[:2]] == ["a\nRMS 0.316 px, 4 % covered", "b\nRMS 0.645 px, 6 % covered"]
    assert (drawn[2].get_xlim(), drawn[0].get_ylim()) == ((-0.75, 0.75), (60.0, 0.0))


BOARD = np.stack([*np.meshgrid(np.arange(5) * 0.1, np.arange(4) * 0.1), np.zeros((4, 5))], axis=-1).reshape(-1, 3)


def views(count, noise_px, rng):
    camera, pixels, poses = Pinhole(640, 480, 400.0, 402.0, 318.0, 243.0), [], []
    while len(pixels) < count:
        T = SE3.exp([*rng.normal(0, 0.1, 2), rng.uniform(0.6, 1.0), *rng.normal(0, 0.35, 3)])
        found, is_seen = camera.project(T.apply(BOARD))
        if is_seen.all():
            pixels.append(found + rng.normal(0.0, noise_px, found.shape))
            poses.append(T.matrix)
    seen = observations([0] * count, range(count), [0] * count, [BOARD] * count, pixels)
    lens = np.array([400.0, 402.0, 318.0, 243.0, *np.zeros(8)])
    origin = SE3(np.eye(4)[None])
    return undistorted(seen), RigState(lens[None], origin, origin, SE3(np.stack(poses)).inverse())


def undistorted(seen):
    """The problem of one camera, of whose lens focal lengths and centre may move."""
    return replace(rig_problem(("pinhole",), ((640, 480),), seen), is_free=np.arange(24) < 4)


def test_images_held_out_show_the_noise_and_a_false_one_of_them_more(monkeypatch, rng):
    problem, state = views(24, 0.2, rng)
    kept = np.ones(24 * 20)
    found = validation.validate(problem, state, kept)
    # 6 of 40 are its pose
    assert found.held_out_px[0] == pytest.approx(0.2 * np.sqrt(2.0) * np.sqrt(1 - 6 / 40), rel=0.15)
    pixels = problem.seen.pixels.copy()
    pixels[problem.seen.view == 3] += rng.normal(0.0, 2.0, (20, 2))  # every fourth is held out
    spoilt = undistorted(observations([0] * 24, range(24), [0] * 24, [BOARD] * 24, np.split(pixels, 24)))
    worse = validation.validate(spoilt, state, kept)
    assert worse.held_out_px[0] > 3 * found.held_out_px[0]
    pixels = problem.seen.pixels + 0.0
    monkeypatch.setattr(validation, "MIN_VIEWS", 19)
    few = validation.validate(problem, state, kept)
    assert np.isnan(few.held_out_px).all()  # 18 are left
    assert np.isnan(few.halves).all()
