"""Recording and mapping by buttons: names, one job at a time, how it ended. The programs have tests of their own."""

import re
import sys

import pytest

from sphere_nav_tools.cli.operate import teaching
from sphere_nav_tools.cli.operate.teaching import Teaching
from worlds.page_client import RECORDER
from worlds.patience import wait_until


def wait_for(holds):
    assert wait_until(holds, 60.0)


@pytest.fixture
def desk(tmp_path, monkeypatch):
    def recorder(node, *words):
        assert node == "bag_recorder"
        assert words[-2:] == ("-p", "topic_set:=raw")
        return [sys.executable, "-c", RECORDER, words[2].removeprefix("output:=")]

    def mapper(code, *words):
        return [sys.executable, "-c", f"import sys; print({' '.join(words)!r}); sys.exit(3)"]

    monkeypatch.setattr(teaching, "node_command", recorder)
    monkeypatch.setattr(teaching, "python_command", mapper)
    desk = Teaching(tmp_path, ["-p", "topic_set:=raw"], ["--rig", "r.yaml"])
    yield desk
    desk.close()


@pytest.mark.dds
def test_a_drive_is_recorded_and_mapped_by_its_name(desk):
    assert desk.describe() == ""
    assert desk.finish() == "nothing is being recorded"
    assert desk.record("yard") == "recording yard"
    wait_for(lambda: re.search(r"2\.0 MB, \d+ GB left", desk.describe()))
    assert desk.record("other") == "recording yard is not over"
    assert desk.drives == []  # a map is made of a drive that is complete
    assert "being completed" in desk.finish()
    wait_for(lambda: not desk.busy)
    assert desk.describe() == "recording yard: done 82 messages"
    assert desk.drives == ["yard"]
    assert "found yard in" in desk.record("yard")
    assert desk.map("yard") == "mapping yard"
    wait_for(lambda: not desk.busy)
    words = f"map {desk.folder / 'yard'} -o {desk.folder / 'yard_map'} --taught {desk.folder / 'yard.tum'} --rig r.yaml"
    assert desk.describe() == f"mapping yard: FAILED (3) {words}"[: len(desk.describe())]
    assert "FAILED (3) map" in desk.describe()


def test_a_name_is_no_path(desk):
    for name in ["", "../yard", "a b", "-x", "y" * 65, "ä"]:
        assert "name: expected letters, digits" in desk.record(name)
        assert "found none" in desk.map(name)
        assert not list(desk.folder.iterdir())


def test_paths_are_what_a_follower_reads_and_a_link_out_of_the_folder_is_neither_mapped_nor_driven(
    desk, tmp_path_factory
):
    there = tmp_path_factory.mktemp("there")
    (there / "drive").mkdir()
    (there / "drive" / "a.mcap").write_bytes(b"")
    (there / "way.csv").write_text("0,0\n")
    for name in ("home", "home_map", "half", "twice"):
        (desk.folder / name).mkdir()
    (desk.folder / "home" / "a.mcap").write_bytes(b"")
    (desk.folder / "home_map" / "map.mcap").write_bytes(b"")
    for name in ("home.tum", "a.csv", "c.geojson"):
        (desk.folder / name).write_text("")
    (desk.folder / "same.tum").symlink_to(desk.folder / "home.tum")
    (desk.folder / "away").symlink_to(there / "drive")
    (desk.folder / "away.csv").symlink_to(there / "way.csv")
    (desk.folder / "half" / "a.mcap").symlink_to(there / "drive" / "a.mcap")
    (desk.folder / "twice" / "a.mcap").write_bytes(b"")
    (desk.folder / "twice_map").symlink_to(there)
    (desk.folder / "ring").symlink_to("ring")
    assert (desk.drives, desk.paths) == (["home", "twice"], ["home.tum", "same.tum", "a.csv"])
    assert desk.path_of("same.tum") == desk.folder / "same.tum"
    assert (desk.map_of("home"), desk.map_of("twice")) == (desk.folder / "home_map", None)
    refused = {desk.map(name) for name in ("away", "half", "none", str(there / "drive"), "away/..", "..", "a\0b")}
    assert refused == {f"drive: expected a recorded one in {desk.folder}, found none"}
    for name in ("away.csv", str(there / "way.csv"), "../way.csv", "home/../home.tum", "none.csv", "."):
        assert desk.path_of(name) is None
        assert desk.map_of(name) is None
    (desk.folder / "gone_map").symlink_to(there / "nothing")
    assert "found gone_map in" in desk.record("gone")  # the link is ours, wherever it leads
