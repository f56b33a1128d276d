"""A folder in a layout that is not understood is told by what it looks like."""

import numpy as np
import pytest

from sphere_nav_tools.cli.main import main
from sphere_nav_tools.offline.importing.frames import describe_folder, guess_format

FILES = {
    "seven_scenes": ("frame-000000.depth.png",),
    "tum": ("rgb.txt",),
    "kitti": ("calib.txt", "image_0/000000.png"),
    "spherical": ("image_0.png", "range_0.png"),
    "openloris": ("color.txt", "aligned_depth.txt"),
    "rover": ("intelrealsense_D435i/rgb/1.5.png",),
    "euroc": ("mav0/cam0/data.csv",),
    "four_seasons": ("undistorted_images/cam0/1.png", "times.txt"),
    "nclt": ("lb3/Cam5/1326030975726043.tiff",),
}


def make(folder, names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(np.zeros(4, np.uint8).tobytes())
    return folder


def test_each_layout_is_known_by_its_files(tmp_path):
    for name in FILES:
        folder = make(tmp_path / name / "data", FILES[name])
        assert guess_format(folder) == name
        assert describe_folder(tmp_path / name) == f"{folder} looks like {name}"


def test_other_folders_are_told_by_what_they_hold(tmp_path):
    assert describe_folder(tmp_path) == "the folder holds nothing"
    assert describe_folder(tmp_path / "none") == ""
    assert describe_folder(make(tmp_path / "notes", ["a.txt", "b.md"])) == "the folder holds a.txt, b.md"
    assert "it has images" in describe_folder(make(tmp_path / "left", ["0.png"]))


@pytest.mark.parametrize(
    ("wanted", "found"), [("tum", "kitti"), ("kitti", "seven_scenes"), ("spherical", "tum"), ("seven_scenes", "kitti")]
)
def test_the_command_refuses_another_layout_by_its_name(tmp_path, capsys, wanted, found):
    folder = make(tmp_path / "data", FILES[found])
    assert main(["import", wanted, str(folder), "-o", str(tmp_path / "bag")]) == 2
    assert f"the folder looks like {found}" in capsys.readouterr().err
