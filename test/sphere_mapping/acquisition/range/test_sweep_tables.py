"""What the sweep knows of cameras of any model: where they have a direction, which of them see it."""

from dataclasses import replace

import numpy as np
import pytest

from sphere_mapping.acquisition.params import StitchParams
from sphere_mapping.acquisition.range.kernels import NUM_HYPOTHESES
from sphere_mapping.acquisition.range.sweep_tables import (
    hypotheses_of,
    hypothesis_table,
    level_of,
    shared_view,
    sharpness,
    sight_of,
    why_no_range,
)
from sphere_mapping.acquisition.stitching.layouts import Layouts
from sphere_nav.geometry import SE3, DoubleSphere, Fisheye, Pinhole, Rig, RigCamera, Spherical
from sphere_nav.params import build
from worlds.rig import OPTICAL

LENSES = (
    Fisheye(160, 160, 48.0, 50.0, 79.5, 77.5, (-0.02, 0.002, 0.0, 0.0)),
    DoubleSphere(160, 120, 60.0, 60.0, 79.5, 59.5, -0.2, 0.6),
    Pinhole(160, 120, 90.0, 90.0, 79.5, 59.5, (-0.1, 0.01, 0.002, -0.003)),
)
WHOLE = Spherical(256, 128)


@pytest.fixture(scope="module")
def views():
    """Three cameras that look ahead, 0.3 m apart, each of another model."""
    poses = [SE3.from_parts(OPTICAL, [0.0, y, 0.0]) for y in (0.3, 0.0, -0.3)]
    rig = Rig(tuple(RigCamera(name, lens, T) for name, lens, T in zip("abc", LENSES, poses, strict=True)))
    return list(Layouts(rig, build(StitchParams, {"width": 256}), {}).views.values())


def test_hypotheses_reach_the_nearest_range_by_steps_of_about_a_pixel(views):
    first, step = hypotheses_of(views, WHOLE, 0.5)
    px = step * 0.3 * WHOLE.pixels_per_radian
    assert 0.69 < px < 1.26
    assert first < 0 < first + 1.5 * step
    assert first + (NUM_HYPOTHESES - 2) * step > 1 / 0.5
    first, step = hypotheses_of(views, WHOLE, 0.25)  # wider steps, that no more of them are needed
    assert first + (NUM_HYPOTHESES - 2) * step == pytest.approx(1 / 0.25)
    wide = [replace(v, T_sphere_camera=SE3.from_parts(OPTICAL, 5 * v.T_sphere_camera.translation)) for v in views]
    assert hypotheses_of(wide, WHOLE, 0.5)[1] * 1.5 * WHOLE.pixels_per_radian < 1.26  # nearer things are given up


def test_a_hypothesis_is_where_the_camera_has_that_point(views):
    level, (first, step) = level_of(WHOLE, views), hypotheses_of(views, WHOLE, 0.5)
    table = hypothesis_table(views, level, first, step)
    row, column, k = 64, 128, 20
    point = WHOLE.unproject(np.array([float(column), row])) / (first + k * step)
    for c, view in enumerate(views):
        expected = view.camera.project(view.T_sphere_camera.inverse().apply(point[None]))[0][0] * level.scales[c]
        np.testing.assert_allclose(table[row // 8, c, column // 8, :, k], expected, atol=1e-3)


def test_who_is_masked_or_absent_does_not_see(views):
    levels = [level_of(WHOLE, views)]
    stretch = sharpness(views, WHOLE)
    ahead = (64, 128)
    whole = sight_of(stretch, np.ones(3, np.bool_), levels)
    assert whole.numbers[ahead] == 3
    assert whole.numbers[64, 0] == 0  # behind
    without = sight_of(stretch, np.array([True, False, True]), levels)
    assert sorted(without.cameras[ahead][:2]) == [0, 2]
    assert without.numbers[ahead] == 2
    covered = replace(views[0], border=np.where(np.arange(160) < 80, views[0].border, 0).astype(np.float32))
    assert level_of(WHOLE, [covered]).is_dead[0][:, 80:].all()
    half = sight_of(sharpness([covered, *views[1:]], WHOLE), np.ones(3, np.bool_), levels)
    assert half.numbers[64, 140] == 2
    assert half.numbers[64, 116] == 3


def test_cameras_that_cannot_measure_are_told_why():
    def rig_of(*poses):
        return Rig(tuple(RigCamera(name, LENSES[2], T) for name, T in zip("ab", poses, strict=False)), name="test")

    ahead, back = (SE3.from_parts(turn @ OPTICAL, [0.0, 0.0, 0.0]) for turn in (np.eye(3), np.diag([-1.0, -1.0, 1.0])))
    beside = SE3.from_parts(OPTICAL, [0.0, 0.3, 0.0])
    assert why_no_range(rig_of(ahead, beside)) == ""
    assert "expected two cameras, found 1" in why_no_range(rig_of(ahead))
    assert "3% of the sphere seen by two cameras, found 0.0% at most (a, b)" in why_no_range(rig_of(ahead, back))
    assert "centres 0.02 m apart, found 0.000 m (a, b)" in why_no_range(rig_of(ahead, ahead))
    a, b = rig_of(ahead, beside).cameras
    assert shared_view(a, b) == pytest.approx(shared_view(b, a))
