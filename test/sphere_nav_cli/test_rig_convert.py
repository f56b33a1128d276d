"""`sphere_nav rig-convert`: a rig file or one line."""

from copy import deepcopy

import pytest
import yaml

from sphere_geometry.rig_file import read_rig
from sphere_nav_cli.main import main

CAM = {"camera_model": "pinhole", "intrinsics": [500.0, 500.0, 320.0, 240.0], "resolution": [640, 480]}
LEFT_OF = [[1, 0, 0, 0.2], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]  # points move to the right


@pytest.fixture
def camchain(tmp_path):
    path = tmp_path / "camchain.yaml"
    path.write_text(yaml.safe_dump({"cam0": CAM, "cam1": deepcopy(CAM) | {"T_cn_cnm1": LEFT_OF}}))
    return path


def run(capsys, *words):
    status = main(["rig-convert", *map(str, words)])
    return status, *map(str.splitlines, capsys.readouterr())


def test_a_camchain_becomes_a_rig_file(capsys, camchain, tmp_path):
    status, out, err = run(capsys, camchain, "-o", tmp_path / "rig.yaml")
    assert (status, err) == (0, [])
    assert out[1] == "cam1: pinhole at [0.  0.2 0. ] m, looks 0.0° to the left, 0.0° up"
    assert read_rig(tmp_path / "rig.yaml").names == ("cam0", "cam1")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--size", "640"], "--size: expected WIDTHxHEIGHT such as 640x480, found '640'"),
        (["--unit", "-1"], "--unit: expected a positive length in m"),
        (["--frame", "imu"], "camchain.yaml: expected poses relative to an IMU"),
    ],
)
def test_misuse_is_one_line(capsys, camchain, tmp_path, words, expected):
    status, out, err = run(capsys, camchain, *words, "-o", tmp_path / "rig.yaml")
    assert (status, out, len(err)) == (2, [], 1)
    assert expected in err[0]
    assert not (tmp_path / "rig.yaml").exists()


def test_a_file_is_kept(capsys, camchain, tmp_path):
    (tmp_path / "rig.yaml").write_text("mine")
    status, _, err = run(capsys, camchain, "-o", tmp_path / "rig.yaml")
    assert status == 2
    assert "it is not overwritten" in err[0]
    assert run(capsys, camchain, "-o", tmp_path / "rig.yaml", "--force")[0] == 0
