"""Files of other programs: told apart by what they hold, or refused in one line."""

import json

import pytest

from sphere_nav.geometry.files.foreign_rig import read_foreign_rig
from worlds.foreign import refusal

CAM0 = {"camera_model": "pinhole", "intrinsics": [500.0, 500.0, 320.0, 240.0], "resolution": [640, 480]}


def test_a_file_that_is_none_is_one_line(tmp_path):
    for text, expected in [
        ("", "expected a Kalibr camchain"),
        ("- 1", "expected a Kalibr camchain"),
        ("[" * 5000, "expected YAML"),
        ("cam0:\n  camera_model: [ds]\n  intrinsics: 1\n  resolution: 2", "cam0.camera_model: expected pinhole"),
    ]:
        (tmp_path / "x.yaml").write_text(text)
        line = refusal(lambda path: read_foreign_rig([path]), tmp_path / "x.yaml")
        assert expected in line
        assert len(line) < 600


def test_a_camchain_is_one_file(tmp_path):
    path = tmp_path / "x.json"
    path.write_text(json.dumps({"cam0": CAM0}))
    assert read_foreign_rig([path]).names == ("cam0",)
    with pytest.raises(ValueError, match="expected one file of Kalibr or basalt, found 2"):
        read_foreign_rig([path, path])
