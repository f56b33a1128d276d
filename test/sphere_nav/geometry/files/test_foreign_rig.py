"""Which program a calibration comes from is told by its content; what it is not is told in one line."""

import json

import pytest

from sphere_nav.geometry.files.foreign_cameras import ForeignLens
from worlds.foreign import read_foreign

CAM0 = {"camera_model": "pinhole", "intrinsics": [500.0, 500.0, 320.0, 240.0], "resolution": [640, 480]}


def test_a_file_that_is_none_is_one_line(tmp_path):
    for text, expected in [
        ("", "expected a Kalibr camchain"),
        ("- 1", "expected a Kalibr camchain"),
        ("a: 2026-99-99", "expected YAML"),
        ("[" * 5000, "expected YAML"),
        ("cam0:\n  camera_model: [ds]\n  intrinsics: 1\n  resolution: 2", "cam0.camera_model: expected pinhole"),
    ]:
        path = tmp_path / "x.yaml"
        path.write_text(text)
        with pytest.raises(ValueError, match=r"x\.yaml: ") as caught:
            read_foreign([path])
        assert expected in str(caught.value)
        assert "\n" not in str(caught.value)
        assert len(str(caught.value)) < 600


def test_a_format_may_be_told(tmp_path):
    path = tmp_path / "x.json"
    path.write_text(json.dumps({"cam0": CAM0}))
    assert read_foreign([path]).names == read_foreign([path], file_format="kalibr").names == ("cam0",)
    with pytest.raises(ValueError, match="value0"):
        read_foreign([path], file_format="basalt")
    with pytest.raises(ValueError, match="expected camera_matrix, M1"):
        read_foreign([path], file_format="opencv")
    with pytest.raises(ValueError, match="expected one kalibr file, found 2"):
        read_foreign([path, path])


def test_only_several_camchains_are_joined(tmp_path):
    for file_format, number in [("kalibr", 1), ("opencv", 2), ("basalt", 2)]:
        path = tmp_path / "x.json"
        path.write_text(json.dumps({"cam0": CAM0}))
        with pytest.raises(ValueError, match=f"expected several camchains of Kalibr, found {number} {file_format}"):
            read_foreign([path] * number, file_format=file_format, is_joining=True)


def test_an_omnidirectional_camera_needs_a_positive_xi():
    with pytest.raises(ValueError, match=r"x: omni: xi: expected 0 to 1000, found -0\.5"):
        ForeignLens((640, 480), 500.0, 500.0, 320.0, 240.0, "x").omni(-0.5)
