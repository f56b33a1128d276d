"""rig.yaml: what is written is read back, and every defect is one line with file, field, expected and found."""

import numpy as np
import pytest
import yaml

from sphere_nav.geometry import SE3, DoubleSphere, Fisheye, OCam, Omni, Pinhole, Rig, RigCamera
from sphere_nav.geometry.files.rig_file import read_rig, write_rig


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
            RigCamera("f", OCam(640, 480, 319.5, 239.5, (200.0, 0.0, -1e-3), 0.99, 0.01), poses[5], level="top"),
        ),
        'a "rig": no',
        "2026-05-01",
    )


@pytest.fixture
def path(rig, tmp_path):
    write_rig(tmp_path / "rig.yaml", rig)
    return tmp_path / "rig.yaml"


def test_what_is_written_is_read_back(rig, path):
    found = read_rig(path)
    assert (found.name, found.version, found.names) == (rig.name, rig.version, rig.names)
    for mine, theirs in zip(rig.cameras, found.cameras, strict=True):
        assert mine.camera == theirs.camera
        np.testing.assert_allclose(mine.T_rig_camera.matrix, theirs.T_rig_camera.matrix, atol=1e-14)
        assert (mine.mask, mine.exposure_group, mine.level) == (theirs.mask, theirs.exposure_group, theirs.level)


def test_a_mask_moves_with_the_folder(path):
    assert "masks/b.png" in path.read_text()
    assert str(path.parent) not in path.read_text()


def test_a_file_is_not_overwritten_unless_told(rig, path):
    with pytest.raises(ValueError, match=r"rig\.yaml: expected no such file, found one"):
        write_rig(path, rig)
    write_rig(path, rig, is_overwriting=True)
    assert [file.name for file in path.parent.iterdir() if file.is_file()] == ["rig.yaml"]


def drop(*keys):
    def change(values):
        inner = values
        for key in keys[:-1]:
            inner = inner[key]
        del inner[keys[-1]]

    return change


def put(*keys_and_value):
    *keys, value = keys_and_value

    def change(values):
        inner = values
        for key in keys[:-1]:
            inner = inner[key]
        inner[keys[-1]] = value

    return change


A = ("cameras", "a")
MIRRORED = np.diag([1.0, 1.0, -1.0, 1.0]).tolist()
STRETCHED = np.diag([1.0, 1.1, 1.0, 1.0]).tolist()
DEFECTS = {
    "missing camera": (drop("cameras", "b"), "cameras: expected 6 (num_cameras), found 5 (a, c, d, e, f)"),
    "missing field": (drop(*A, "model"), "cameras.a.model: expected a value, found none"),
    "unknown model": (
        put(*A, "model", "mei"),
        "cameras.a.model: expected pinhole, fisheye, double_sphere, omni, ocam, found 'mei'",
    ),
    "other size": (
        put(*A, "width", 300),
        "cameras.a.intrinsics: expected the centre inside the 300 x 480 image, found",
    ),
    "short matrix": (put(*A, "T_rig_camera", [[1, 2], [3]]), "cameras.a.T_rig_camera: expected 4 rows of 4 numbers"),
    "a list for a model": (put(*A, "model", ["pinhole"]), "cameras.a.model: expected pinhole"),
    "ocam without polynomial": (put("cameras", "f", "polynomial", []), "cameras.f: ocam: polynomial: expected 1 to 20"),
    "unknown level": (put(*A, "level", "up"), "cameras.a: a: level: expected top, bottom or nothing, found 'up'"),
}


def test_a_defect_is_one_line_with_its_place(path):
    good = path.read_text()
    for name in DEFECTS:
        change, expected = DEFECTS[name]
        values = yaml.safe_load(good)
        change(values)
        path.write_text(yaml.safe_dump(values, sort_keys=False))
        with pytest.raises(ValueError, match=r"rig\.yaml") as caught:
            read_rig(path)
        assert expected in str(caught.value)
        assert "\n" not in str(caught.value)


def test_a_file_that_is_no_rig_is_refused(tmp_path):
    for text, found in [("a: [", "expected YAML"), ("", "rig: expected the fields"), ("x: 1\nx: 2", "twice")]:
        (tmp_path / "rig.yaml").write_text(text)
        with pytest.raises(ValueError, match=r"rig\.yaml: ") as caught:
            read_rig(tmp_path / "rig.yaml")
        assert found in str(caught.value)
        assert "\n" not in str(caught.value)
