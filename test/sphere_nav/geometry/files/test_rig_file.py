"""rig.yaml: what is written is read back, and every defect is one line with file, field, expected and found."""

import numpy as np
import pytest
import yaml

from sphere_nav.geometry import SE3, DoubleSphere, Fisheye, Omni, Pinhole, Rig, RigCamera, Spherical
from sphere_nav.geometry.files.rig_file import read_rig, write_rig
from sphere_nav.geometry.files.untrusted import LIMITS
from sphere_nav.ros.conversions import camera_to_sphere_info, sphere_info_to_camera
from sphere_nav_tools.offline.importing.files import read_image
from worlds.foreign import refusal


@pytest.fixture
def rig(tmp_path):
    poses = [SE3.exp(xi) for xi in np.random.default_rng(0).normal(size=(6, 6))]
    (tmp_path / "masks").mkdir()
    (tmp_path / "masks" / "b.png").write_bytes(b"an image")
    return Rig(
        (
            RigCamera("a", Pinhole(640, 480, 500.1, 500.2, 319.5, 239.5), poses[0], None, "sun", "top"),
            RigCamera(
                "b",
                Pinhole(640, 480, 500.1, 500.2, 319.5, 239.5, (0.1, 0.01, 1e-3, 1e-4, 0.002)),
                poses[1],
                str(tmp_path / "masks" / "b.png"),
                "",
                "bottom",
            ),
            RigCamera("c", Fisheye(640, 640, 200.0, 201.0, 319.5, 320.5, (0.1, 0.02, 0.0, 0.0)), poses[2], level="top"),
            RigCamera("d", DoubleSphere(640, 640, 200.0, 201.0, 319.5, 320.5, -0.2, 0.6), poses[3], level="top"),
            RigCamera("e", Omni(640, 480, 800.0, 801.0, 319.5, 239.5, 1.2, (0.1, 0.02)), poses[4], level="top"),
        ),
        'a "rig": no',
        "2026-05-01",
    )


@pytest.fixture
def path(rig, tmp_path):
    write_rig(tmp_path / "rig.yaml", rig)
    return tmp_path / "rig.yaml"


def test_what_is_written_is_read_back_and_a_mask_moves_with_the_folder(rig, path):
    found = read_rig(path)
    assert (found.name, found.version, found.names) == (rig.name, rig.version, rig.names)
    for mine, theirs in zip(rig.cameras, found.cameras, strict=True):
        assert mine.camera == theirs.camera
        np.testing.assert_allclose(mine.T_rig_camera.matrix, theirs.T_rig_camera.matrix, atol=1e-14)
        assert (mine.mask, mine.exposure_group, mine.level) == (theirs.mask, theirs.exposure_group, theirs.level)
    assert "masks/b.png" in path.read_text()
    assert str(path.parent) not in path.read_text()


def test_a_file_is_written_whole(rig, path):
    write_rig(path, rig)
    assert [file.name for file in path.parent.iterdir() if file.is_file()] == ["rig.yaml"]


def inner(values, keys):
    for key in keys:
        values = values[key]
    return values


def drop(*keys):
    return lambda values: inner(values, keys[:-1]).pop(keys[-1])


def put(*keys_and_value):
    *keys, last, value = keys_and_value
    return lambda values: inner(values, keys).update({last: value})


A = ("cameras", "a")
MODELS = "pinhole, fisheye, double_sphere, omni"
DEFECTS = [
    (drop("cameras", "b"), "cameras: expected 5 (num_cameras), found 4 (a, c, d, e)"),
    (drop(*A, "model"), "cameras.a.model: expected a value, found none"),
    (put(*A, "model", "mei"), f"cameras.a: model: expected {MODELS}, found 'mei'"),
    (put(*A, "width", 300), "cameras.a: intrinsics: expected the centre inside the 300 x 480 image, found"),
    (put(*A, "T_rig_camera", [[1, 2], [3]]), "cameras.a: T_rig_camera: expected 4 rows of 4 numbers"),
    (put(*A, "model", ["pinhole"]), "cameras.a: model: expected pinhole"),
    (put("format_version", 9), "format, format_version: expected"),
    (put("cameras", {}), "cameras: expected camera names with their fields, found {}"),
    (put(*A, "mask", "gone.png"), "cameras.a: mask: expected an image file, found no gone.png"),
    (put(*A, "polynomial", [0.1]), "cameras.a.polynomial: expected only model, width"),
    (put("cameras", "c", "distortion", [0.1]), "cameras.c: distortion: expected 4 finite numbers"),
    (put("cameras", "d", "distortion", [0.1]), "distortion: expected none for double_sphere"),
    (put(*A, "level", "up"), "cameras.a: a: level: expected top, bottom or nothing, found 'up'"),
]


def test_a_defect_is_one_line_with_its_place(path):
    good = path.read_text()
    for change, expected in DEFECTS:
        values = yaml.safe_load(good)
        change(values)
        path.write_text(yaml.safe_dump(values, sort_keys=False))
        assert expected in refusal(read_rig, path)


def test_a_file_beyond_its_limit_is_not_read(tmp_path):
    path, limit = tmp_path / "sparse.png", LIMITS["image file"]
    with path.open("wb") as file:
        file.truncate(limit + 1)  # takes no room on the disk
    with pytest.raises(ValueError, match=f"of at most {limit} bytes, found {limit + 1}"):
        read_image(path)


def test_a_sphere_of_8192_columns_is_the_largest():
    largest, larger = (camera_to_sphere_info(Spherical(2 * rows, rows), "sphere") for rows in (4096, 4097))
    assert sphere_info_to_camera(largest).width == 8192
    with pytest.raises(ValueError, match=r"info\.width, height: expected up to"):
        sphere_info_to_camera(larger)
