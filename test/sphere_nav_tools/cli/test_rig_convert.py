"""`sphere_nav rig-convert`: a rig file or one line."""

from copy import deepcopy

import numpy as np
import pytest
import yaml

from sphere_nav.geometry import SE3
from sphere_nav.geometry.files.rig_file import read_rig
from sphere_nav_tools.cli.main import main

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


def test_misuse_is_one_line_and_a_file_is_kept(capsys, camchain, tmp_path):
    status, out, err = run(capsys, camchain, "--frame", "imu", "-o", tmp_path / "rig.yaml")
    assert (status, out, len(err)) == (2, [], 1)
    assert "camchain.yaml: expected poses relative to an IMU" in err[0]
    assert not (tmp_path / "rig.yaml").exists()
    (tmp_path / "rig.yaml").write_text("mine")
    status, _, err = run(capsys, camchain, "-o", tmp_path / "rig.yaml")
    assert status == 2
    assert "rig.yaml: expected no such file, found one" in err[0]
    assert run(capsys, camchain, "-o", tmp_path / "rig.yaml", "--overwrite")[0] == 0


def test_a_camera_is_told_by_where_it_looks(capsys, tmp_path):
    left, up = SE3.exp(np.radians([0, 0, 0, 0, -30, 0])), SE3.exp(np.radians([0, 0, 0, 20, 0, 0]))  # about optical axes
    path, T_cam1_cam0 = tmp_path / "camchain.yaml", (left @ up).inverse()
    path.write_text(yaml.safe_dump({"cam0": CAM, "cam1": CAM | {"T_cn_cnm1": T_cam1_cam0.matrix.tolist()}}))
    _, out, _ = run(capsys, path, "-o", tmp_path / "rig.yaml")
    assert out[1].endswith("looks 30.0° to the left, 20.0° up")
