"""Files that the package brings along are found."""

import xml.etree.ElementTree as ET

import pytest

from sphere_nav.ros.shared_files import share_file, software


def test_the_profile_for_large_messages():
    root = ET.parse(share_file("config/fastdds_large.xml")).getroot()
    sizes = [int(item.text) for item in root.iter() if item.tag.endswith("segment_size")]
    assert sizes
    assert min(sizes) > 2048 * 1024 * (3 + 4)  # a sphere of 2048 x 1024, colour and range


def test_a_file_in_an_ament_prefix(tmp_path, monkeypatch):
    (tmp_path / "share/sphere_nav/config").mkdir(parents=True)
    (tmp_path / "share/sphere_nav/config/site.yaml").touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path}")
    assert share_file("config/site.yaml") == tmp_path / "share/sphere_nav/config/site.yaml"


def test_a_file_that_is_nowhere():
    with pytest.raises(ValueError, match=r"config/none\.yaml: file of sphere_nav not found in /"):
        share_file("config/none.yaml")


def test_the_software_is_named():
    assert software().startswith("sphere_nav ")
