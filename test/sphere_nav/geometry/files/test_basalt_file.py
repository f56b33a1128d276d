"""basalt's calibration: poses as ours, models by their names there."""

import json

import numpy as np
import pytest

from sphere_nav.geometry import SE3, DoubleSphere, Fisheye, Pinhole
from sphere_nav.geometry.files.foreign_rig import read_foreign_rig
from worlds.foreign import refusal

SIZE = (640, 480)
RADTAN8 = (0.1, 0.02, 1e-3, -2e-4, 0.003, 0.2, 0.03, 0.001)
CAMERAS = {
    "ds": DoubleSphere(*SIZE, 225.0, 222.6, 310.8, 242.7, -0.28, 0.57),
    "ucm": DoubleSphere(*SIZE, 225.0, 222.6, 310.8, 242.7, 0.0, 0.61),
    "kb4": Fisheye(*SIZE, 275.5, 275.4, 315.4, 248.0, (-0.0068, 0.0137, -0.0087, 0.0016)),
    "pinhole": Pinhole(*SIZE, 500.0, 501.0, 320.0, 240.0),
    "pinhole-radtan8": Pinhole(*SIZE, 500.0, 501.0, 320.0, 240.0, RADTAN8),
}
FURTHER = {
    "ds": ("xi", "alpha"),
    "ucm": ("alpha",),
    "kb4": ("k1", "k2", "k3", "k4"),
    "pinhole": (),
    "pinhole-radtan8": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
}
POSES = tuple(SE3.exp(xi) for xi in np.random.default_rng(5).normal(0.0, 0.7, (5, 6)))


def calibration():
    poses, lenses = [], []
    for (kind, camera), pose in zip(CAMERAS.items(), POSES, strict=True):
        own = {"xi": camera.xi, "alpha": camera.alpha} if isinstance(camera, DoubleSphere) else {}
        own |= dict(zip(FURTHER[kind], getattr(camera, "distortion", ()), strict=False))
        lens = {name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy")}
        more = {"rpmax": 2.7} if kind == "pinhole-radtan8" else {}
        lenses.append({"camera_type": kind, "intrinsics": lens | {name: own[name] for name in FURTHER[kind]} | more})
        keys = ("px", "py", "pz", "qx", "qy", "qz", "qw")
        poses.append(dict(zip(keys, [*map(float, pose.translation), *map(float, pose.quaternion)], strict=True)))
    return {"value0": {"T_imu_cam": poses, "intrinsics": lenses, "resolution": [list(SIZE)] * 5, "gyro_noise_std": 0.1}}


@pytest.fixture
def path(tmp_path):
    (tmp_path / "calibration.json").write_text(json.dumps(calibration(), indent=4))
    return tmp_path / "calibration.json"


def test_what_basalt_writes_is_read(path):
    found = read_foreign_rig([path])
    assert [part.camera for part in found.cameras] == list(CAMERAS.values())


def test_the_rig_is_placed_by_the_imu_or_by_its_first_camera(path):
    rig = read_foreign_rig([path], frame="imu")
    for mine, pose in zip(rig.cameras, POSES, strict=True):
        np.testing.assert_allclose(mine.T_rig_camera.matrix, pose.matrix, atol=1e-12)
    first, *others = (part.T_rig_camera for part in read_foreign_rig([path]).cameras)
    np.testing.assert_allclose(first.rotation @ [0, 0, 1], [1, 0, 0], atol=1e-12)
    for mine, pose in zip(others, POSES[1:], strict=True):
        np.testing.assert_allclose((first.inverse() @ mine).matrix, (POSES[0].inverse() @ pose).matrix, atol=1e-12)


def lens(index, field, value):
    return lambda inner: inner["intrinsics"][index].__setitem__(field, value)


ALPHA = {**dict.fromkeys(("fx", "fy", "cx", "cy"), 300.0), "xi": 0.0, "alpha": 2.0}
DEFECTS = [
    (lens(1, "camera_type", "eucm"), "intrinsics[1].camera_type: expected ds, ucm, kb4"),
    (lambda inner: inner["T_imu_cam"].pop(), "found 4 of T_imu_cam, 5 of intrinsics, 5 of resolution"),
    (lambda inner: inner["T_imu_cam"][0].update(qw=9.0), "expected a unit quaternion, found one of"),
    (lambda inner: inner.pop("resolution"), "value0.resolution: expected a value, found none"),
    (lens(0, "intrinsics", ALPHA), "alpha"),
]


def test_a_defect_is_one_line_with_its_place(path):
    for change, expected in DEFECTS:
        values = calibration()
        change(values["value0"])
        path.write_text(json.dumps(values))
        assert expected in refusal(lambda path: read_foreign_rig([path]), path)
