"""`sphere_nav calibrate`: what it refuses."""

import cv2
import numpy as np
import pytest

from sphere_nav_tools.cli.main import main


def run(capsys, *words):
    status = main(["calibrate", *map(str, words)])
    return status, capsys.readouterr().err.strip().splitlines()[-1]


@pytest.fixture
def folder(tmp_path):
    cam = tmp_path / "cam0"
    cam.mkdir()
    for number in range(2):
        cv2.imwrite(str(cam / f"{number}.png"), np.full((48, 64), 128, dtype=np.uint8))
    return cam


def test_missing_images(capsys, tmp_path):
    status, line = run(capsys, tmp_path / "none", "--board", "8x6", "--square", "0.03", "-o", tmp_path / "rig.yaml")
    assert status == 2
    assert "none: expected images, found none" in line


@pytest.mark.dds
def test_unreadable_image(capsys, folder, tmp_path):
    (folder / "1.png").write_text("no image")
    status, line = run(capsys, folder, "--board", "8x6", "--square", "0.03", "-o", tmp_path / "rig.yaml")
    assert status == 2
    assert "1.png: expected an image" in line


def test_image_of_another_size(capsys, folder, tmp_path):
    cv2.imwrite(str(folder / "1.png"), np.zeros((40, 64), dtype=np.uint8))
    status, line = run(capsys, folder, "--board", "8x6", "--square", "0.03", "-o", tmp_path / "rig.yaml")
    assert status == 2
    assert "1.png: expected 64x48" in line
